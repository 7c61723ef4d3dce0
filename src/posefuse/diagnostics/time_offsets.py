"""Present the time offsets and clock drifts of all views by the joint estimate of poses and clocks."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from posefuse.calibration.joint.evidence import CLOCK_KINDS
from posefuse.diagnostics.examination import Examination
from posefuse.diagnostics.start_offsets import medoid
from posefuse.model.options.sync import NEAR_FRAMES

_MIN_SHARED_SAMPLES = 15
"""Samples at which two views must see the same point for their clocks to be compared."""
_MIN_DROPPED_FRAMES = 0.5
_EQUAL_Z, _SIGNIFICANT_Z = 3.0, 3.0
_KNOWN_Z = 2.0
"""Offsets of free-running cameras that are this many standard deviations from 0 are worth correcting."""
_MAX_OFFSET_SD_S = 0.1
"""Above this standard deviation, the recording does not determine a time offset: the people hardly move."""


@dataclass(frozen=True, eq=False)
class ViewTiming:
    """Hold the timing of one view.

    Attributes:
        camera: name of the camera.
        start_s: timestamp of the view from which each row holds.
        offset_s: of each row: true time minus timestamp, at ``start_s``.
        drift_ppm: of each row: rate of change of the offset, in parts per million.
        offset_sd_s: standard deviation of the offset, in the middle of the recording.
        drift_sd_ppm: standard deviation of the drift, whether or not a drift was found.
        is_corrected: whether :func:`sync_options` corrects this clock: it is wrong, or it is one of free-running
            cameras, and its offset is known well enough.
    """

    camera: str
    start_s: tuple[float, ...]
    offset_s: tuple[float, ...]
    drift_ppm: tuple[float, ...]
    offset_sd_s: float
    drift_sd_ppm: float
    is_corrected: bool = False

    @property
    def is_observable(self) -> bool:
        """Return whether the recording determines the time offset."""
        return self.offset_sd_s <= _MAX_OFFSET_SD_S


def time_views(examination: Examination, reference: int | None = None) -> tuple[ViewTiming, ...] | None:
    """Return the timing of all connected views, or None if the views do not agree well enough.

    Args:
        examination: of the recording.
        reference: index of the view with the reference clock; by default the clock that most views share.
    """
    if examination.fine is None or examination.verdict is None:
        return None
    views = _connected_views(examination.fine.final.points.weight > 0, reference)
    if len(views) < 2:
        return None
    verdict = examination.verdict
    clocks, covariance = verdict.clocks()
    n = len(clocks)
    wrong = np.array([bool(verdict.of(v, CLOCK_KINDS)) or bool(_dropped_samples(examination, v)) for v in range(n)])
    wrong |= verdict.rate_error != 0.0
    if reference is not None:
        common = np.eye(n)[reference]
    else:
        common = _common_clock(clocks[:, 0], covariance[:n, :n], views, wrong | verdict.is_free_running)
    relative = np.eye(n) - common
    sds, (offset_s, drift) = _sds(relative, covariance[:n, :n]), (relative @ clocks).T
    if reference is not None and wrong.any():
        wrong |= np.abs(offset_s) > _SIGNIFICANT_Z * sds
        wrong[reference] = False
    if verdict.is_free_running:
        known = np.abs(offset_s) > np.maximum(_KNOWN_Z * sds, NEAR_FRAMES * examination.observations.period_s)
        wrong |= known & ~(verdict.gain_by_offsets(common) <= 0.0)
    drift_sds = np.maximum(_sds(relative, covariance[n:, n:]), verdict.estimate.sd[:, 7])
    return tuple(
        ViewTiming(
            examination.observations.rig.names[v],
            *_rows(examination, v, float(offset_s[v]), float(drift[v])),
            offset_sd_s=float(sds[v]),
            drift_sd_ppm=1e6 * float(drift_sds[v]),
            is_corrected=bool(wrong[v]),
        )
        for v in views
    )


def _sds(combination: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the standard deviations of linear combinations."""
    return np.sqrt(np.maximum(np.diag(combination @ covariance @ combination.T), 0.0))


def _connected_views(seen: np.ndarray, reference: int | None) -> list[int]:
    """Return the views connected by shared points: with the reference, or the largest group.

    Args:
        seen: shape (sample, column, view).
        reference: index of the view with the reference clock, or None.
    """
    both = np.stack([(seen & seen[..., v : v + 1]).any(axis=1).sum(axis=0) for v in range(seen.shape[2])])
    group = connected_components(both >= _MIN_SHARED_SAMPLES, directed=False)[1]
    chosen = group[reference] if reference is not None else np.argmax(np.bincount(group))
    return np.flatnonzero(group == chosen).tolist()


def _common_clock(offset_s: np.ndarray, covariance: np.ndarray, views: list[int], wrong: np.ndarray) -> np.ndarray:
    """Return the weights of the clocks whose mean is the common one, shape (view,).

    They are those that are not wrong; without any, those that do not differ from the medoid.
    """
    weights = np.zeros(len(offset_s))
    right = [v for v in views if not wrong[v]]
    if right:
        weights[right] = 1.0 / len(right)
        return weights
    to_mean = np.eye(len(offset_s))
    to_mean[:, views] -= 1.0 / len(views)
    sds = _sds(to_mean, covariance)[views]
    away = np.abs(offset_s[views] - medoid(offset_s[views]))
    near = away <= _EQUAL_Z * np.hypot(sds, sds[np.argmin(away)])
    weights[views] = near * sds**-2.0
    return weights / weights.sum()


def _rows(
    examination: Examination, view: int, offset_s: float, drift: float
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """Return start, offset and drift of a view for each run without dropped frames."""
    assert examination.fine is not None
    assert examination.verdict is not None
    verdict, frames = examination.verdict, examination.fine.final.model.frames
    time_s = examination.observations.frame_time_s[frames]
    offsets_s = verdict.offsets_s(view, time_s, offset_s, drift)
    # Rows of the file count the timestamps of the view itself.
    slope = verdict.slope(view, drift)
    drift = slope / (1.0 - slope)
    pieces = np.split(np.arange(len(offsets_s)), _dropped_samples(examination, view))
    rows = []
    for number, piece in enumerate(pieces):
        # The view's own timestamps; where frames are missing, that of the next frame.
        since = float(time_s[piece[0]] - offsets_s[piece[0]]) if number else 0.0
        at = float(offsets_s[piece].mean() + drift * (since - (time_s[piece] - offsets_s[piece]).mean()))
        rows.append((since, at, 1e6 * drift))
    start_s, offsets, drifts = zip(*rows, strict=True)
    return start_s, offsets, drifts


def _dropped_samples(examination: Examination, view: int) -> list[int]:
    """Return the samples from which on a view has dropped more frames."""
    fine = examination.fine
    assert fine is not None
    blocks = fine.final.system.block_index
    steps = {
        int(np.argmax(blocks >= fault.hypothesis.since_block))
        for fault in fine.accepted
        if fault.hypothesis.view == view
        and fault.hypothesis.kind == "dropped"
        and abs(fault.values[-1]) > _MIN_DROPPED_FRAMES * examination.observations.period_s
    }
    return sorted(steps - {0})
