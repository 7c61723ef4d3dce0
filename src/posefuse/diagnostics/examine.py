"""Examine a recording: normalize its observations and search for gross, then for small faults."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.diagnostics import coarse_search, fine_search
from posefuse.diagnostics.coarse_search import CoarseResult
from posefuse.diagnostics.examination import Examination
from posefuse.diagnostics.fine_result import FineResult
from posefuse.diagnostics.left_right_swaps import detect_swaps, undo_swaps
from posefuse.diagnostics.normalized_views import normalize_views
from posefuse.diagnostics.observations import TrackedObservations, sample_frames
from posefuse.diagnostics.recording_model import RecordingModel
from posefuse.diagnostics.sample_points import triangulate_samples
from posefuse.diagnostics.verdict import judge
from posefuse.parallel import ONE_JOB, Jobs

_COARSE_SPACING_S, _MIN_COARSE_SAMPLES, _MAX_COARSE_COLUMNS = 0.1, 100, 13
_MAX_COARSE_POINTS = _MIN_COARSE_SAMPLES * _MAX_COARSE_COLUMNS
_FREQUENT_SWAPS = 0.05
_MIN_SAMPLES = 8
_BLOCK_S, _MIN_BLOCKS = 1.0, 12
_POSE_KINDS, _MIN_RELOCATED = ("pose", "rotation", "lateral"), 3


@dataclass(frozen=True)
class Effort:
    """Set how closely a recording is examined.

    Attributes:
        min_spacing_s: shortest time between samples.
        max_samples: largest number of samples.
        max_offset_s: largest time offset of a view.
        max_comparisons: bound of the search for gross faults; see :class:`WorkBudget`.
        max_faults: largest number of small faults to find; by default twice the number of views.
    """

    min_spacing_s: float = 0.12
    max_samples: int = 600
    max_offset_s: float = 2.0
    max_comparisons: int = 1_000_000
    max_faults: int | None = None


DEEP = Effort()
SHORT = Effort(0.25, 150, 1.0, 30_000, 5)


def examine(
    observations: TrackedObservations,
    effort: Effort = DEEP,
    groups: Sequence[str] = ("pose", "lens", "clock"),
    jobs: Jobs = ONE_JOB,
) -> Examination:
    """Search for the faults of a recording.

    Args:
        observations: of the recording.
        effort: how closely to look.
        groups: which small faults to consider: ``pose``, ``lens``, ``clock``.
        jobs: processes that test the corrections of suspect views.
    """
    frames = _samples(observations, effort.min_spacing_s, effort.max_samples)
    if observations.n_views < 2 or len(frames) < _MIN_SAMPLES or not len(observations.keypoint_index):
        return Examination(observations, observations, None, None, np.zeros(observations.n_views), None)
    subset = observations.select_columns(_coarse_columns(len(observations.keypoint_index), observations.mirror_column))
    most = max(_MIN_COARSE_SAMPLES, _MAX_COARSE_POINTS // len(subset.keypoint_index))
    coarse_frames = _samples(observations, _COARSE_SPACING_S, most)
    coarse = coarse_search.search(subset, coarse_frames, effort.max_offset_s, effort.max_comparisons, jobs)
    model = coarse.model.resampled(frames)
    shares, corrected = np.zeros(observations.n_views), observations
    if not coarse.views_agree:
        return Examination(observations, observations, coarse, None, shares, None)
    shares, _ = _detect_swaps(observations, coarse.model)
    if (shares > _FREQUENT_SWAPS).any():
        shares, corrected = _without_swaps(observations, model)
    fine = fine_search.search(corrected, model, groups, _block_s(observations), effort.max_faults)
    if _most_cameras_relocated(coarse, fine, observations.n_views):
        return Examination(observations, observations, replace(coarse, views_agree=False), None, shares, None)
    verdict = judge(corrected, coarse, fine, effort.max_samples)
    return Examination(corrected, observations, coarse, fine, shares, fine.final.points, verdict)


def _most_cameras_relocated(coarse: CoarseResult, fine: FineResult, views: int) -> bool:
    """Return whether all cameras but one needed a new pose, which means that the calibration itself is wrong."""
    relocated = {correction.view for correction in coarse.corrections if correction.kind == "pose"}
    relocated |= {fault.hypothesis.view for fault in fine.accepted if fault.hypothesis.kind in _POSE_KINDS}
    return len(relocated) >= max(views - 1, _MIN_RELOCATED)


def _samples(observations: TrackedObservations, min_spacing_s: float, max_samples: int) -> np.ndarray:
    """Return sampled frames in which at least two views have detections."""
    frames = sample_frames(
        len(observations.pixels), observations.runs, observations.period_s, min_spacing_s, max_samples
    )
    visible = np.isfinite(observations.pixels[frames][..., 0]).any(axis=-1).sum(axis=1)
    return frames[visible >= 2]


def _coarse_columns(columns: int, mirror_column: np.ndarray) -> np.ndarray:
    """Return a subset of the columns for the coarse search, with opposite sides together."""
    if columns <= _MAX_COARSE_COLUMNS:
        return np.arange(columns)
    picked: list[int] = []
    for column in np.linspace(0, columns - 1, _MAX_COARSE_COLUMNS).astype(int):
        picked += [int(column), int(mirror_column[column])]
    return np.array(sorted(set(picked)))


def _detect_swaps(observations: TrackedObservations, model: RecordingModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the swap shares of all views and the mask of swapped samples."""
    return detect_swaps(
        observations, model, triangulate_samples(observations, model, normalize_views(observations, model))
    )


def _without_swaps(observations: TrackedObservations, model: RecordingModel) -> tuple[np.ndarray, TrackedObservations]:
    """Return the swap shares, and the observations with the swaps of frequently swapping views undone."""
    shares, mask = _detect_swaps(observations, model)
    corrected = undo_swaps(observations, model.frames, mask & (shares > _FREQUENT_SWAPS)[None, :, None])
    return shares, corrected


def _block_s(observations: TrackedObservations) -> float:
    """Return the length of the blocks of time that count as independent."""
    duration_s = observations.period_s * len(observations.pixels)
    return min(_BLOCK_S, max(duration_s / _MIN_BLOCKS, 2.0 * observations.period_s))
