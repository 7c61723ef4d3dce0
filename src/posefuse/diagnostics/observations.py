"""Collect the tracked 2D keypoints of a recording for the recording check, one column per person and keypoint."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.arrays import ranges
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import CHUNK_FRAMES, Detections
from posefuse.model.tracks import Tracks
from posefuse.preprocess.timeline import fill_missing_times
from posefuse.skeleton.skeletons import Skeleton

_MAX_COLUMNS = 52
_MIN_SHARED_VIEWS = 0.02


@dataclass(frozen=True, eq=False)
class TrackedObservations:
    """Hold the tracked 2D keypoints of some frames of a recording, in memory.

    A column is one keypoint of one person.

    Attributes:
        rig: one camera per view, in the order of the views.
        skeleton: names and relations of the keypoints.
        pixels: shape (frame, view, column, 2), NaN where not detected.
        confidence: shape (frame, view, column), NaN where not detected, 1 where the detector gives none.
        time_s: shape (frame, view): timestamp of each frame in each view; finite.
        frame_numbers: shape (frame,).
        runs: shape (frame,), int: index of the contiguous piece of the recording that holds the frame.
        keypoint_index: shape (column,), int: index into the skeleton's keypoints.
        mirror_column: shape (column,), int: column of the same person's opposite side; the column itself where there is
            none.
        period_s: time between frames.
        confidence_varies: whether confidences lie between 0 and 1 and differ, so that they can be informative.
        rate_known: whether the files state the frame rate; otherwise ``period_s`` assumes 25 frames per second.
    """

    rig: CameraRig
    skeleton: Skeleton
    pixels: np.ndarray
    confidence: np.ndarray
    time_s: np.ndarray
    frame_numbers: np.ndarray
    runs: np.ndarray
    keypoint_index: np.ndarray
    mirror_column: np.ndarray
    period_s: float
    confidence_varies: bool
    rate_known: bool

    @property
    def n_views(self) -> int:
        """Return the number of views."""
        return self.pixels.shape[1]

    @property
    def frame_time_s(self) -> np.ndarray:
        """Return the time of each frame, averaged over the views, shape (frame,)."""
        return self.time_s.mean(axis=1)

    def select_columns(self, chosen: np.ndarray) -> "TrackedObservations":
        """Return the observations of some columns.

        A column whose opposite side is not selected becomes its own mirror.
        """
        place = np.full(len(self.keypoint_index), -1)
        place[chosen] = np.arange(len(chosen))
        mirror_column = place[self.mirror_column[chosen]]
        return replace(
            self,
            pixels=self.pixels[:, :, chosen],
            confidence=self.confidence[:, :, chosen],
            keypoint_index=self.keypoint_index[chosen],
            mirror_column=np.where(mirror_column >= 0, mirror_column, np.arange(len(chosen))),
        )


def gather_observations(
    rig: CameraRig, detections: Detections, tracks: Tracks, spans: Sequence[tuple[int, int]] | None = None
) -> TrackedObservations:
    """Collect the observations of a recording, or of ranges of it.

    Args:
        rig: one camera per view.
        detections: detections of the recording.
        tracks: assignment of detections to people in the frames of the ranges.
        spans: first frame and end of each range, in ascending order; by default the whole recording.
    """
    spans = [(0, detections.n_frames)] if spans is None else spans
    frame_numbers, given_s = (
        np.concatenate([np.asarray(each[start:stop]) for start, stop in spans])
        for each in (detections.frame_numbers, detections.time_s)
    )
    n_people, n_views, n_keypoints = len(tracks.person_ids), detections.n_views, len(detections.skeleton)
    n_frames = len(frame_numbers)
    shape = (n_frames, n_views, n_people, n_keypoints)
    pixels, confidence = np.full((*shape, 2), np.nan), np.full(shape, np.nan)
    place = 0
    # Few frames at a time, since a copy of all detections takes too much memory.
    for start, stop in spans:
        for first, last in ranges(stop - start, CHUNK_FRAMES):
            piece = detections.frames(start + first, start + last)
            rows = tracks.frames(place, place + last - first).rows(piece)
            f, p, v = np.nonzero(rows >= 0)
            pixels[place + f, v, p] = np.asarray(piece.keypoints_px)[rows[f, p, v]]
            confidence[place + f, v, p] = np.asarray(piece.confidence)[rows[f, p, v]]
            place += last - first
    pixels = pixels.reshape(n_frames, n_views, n_people * n_keypoints, 2)
    confidence = confidence.reshape(pixels.shape[:3])
    confidence_varies = _clean_confidence(pixels, confidence)
    time_s, period_s, rate_known = _view_times(frame_numbers, given_s, detections.rate_hz)
    person = np.repeat(np.arange(n_people), n_keypoints)
    runs = np.repeat(np.arange(len(spans)), [stop - start for start, stop in spans])
    all_columns = TrackedObservations(
        rig=rig,
        skeleton=detections.skeleton,
        pixels=pixels,
        confidence=confidence,
        time_s=time_s,
        frame_numbers=frame_numbers,
        runs=runs,
        keypoint_index=np.tile(np.arange(n_keypoints), n_people),
        mirror_column=person * n_keypoints + np.tile(detections.skeleton.mirror, n_people),
        period_s=period_s,
        confidence_varies=confidence_varies,
        rate_known=rate_known,
    )
    return all_columns.select_columns(_informative_columns(all_columns))


def _clean_confidence(pixels: np.ndarray, confidence: np.ndarray) -> bool:
    """Set missing confidences to 1 in place, and return whether the known ones are informative."""
    seen = np.isfinite(pixels[..., 0])
    seen &= np.isfinite(pixels[..., 1])
    given = np.isfinite(confidence)
    known = confidence[seen & given]
    confidence_varies = bool(len(known)) and known.min() >= 0.0 and known.max() <= 1.001 and float(np.std(known)) > 1e-3
    confidence[~given] = 1.0
    confidence[~seen] = np.nan
    return confidence_varies


def _view_times(frame_numbers: np.ndarray, time_s: np.ndarray, rate_hz: float | None) -> tuple[np.ndarray, float, bool]:
    """Return the time of every frame in every view without gaps, the period, and whether the files state it."""
    numbers, times = frame_numbers.astype(float), time_s.astype(float)
    known = np.isfinite(times).sum(axis=0)
    rate_known = rate_hz is not None or bool((known > 1).all())
    rate = rate_hz or 25.0
    for v in range(times.shape[1]):
        if known[v] > 1:
            times[:, v] = fill_missing_times(times[:, v], frame_numbers)
        else:
            times[:, v] = numbers / rate
    steps = np.diff(times, axis=0) / np.diff(numbers)[:, None]
    return times, float(np.median(steps)) if len(steps) else 1.0 / rate, rate_known


def _informative_columns(observations: TrackedObservations) -> np.ndarray:
    """Return the columns that several views see often enough, with a limit on their number.

    Core keypoints come first, then the columns that most views see.
    """
    seen = np.isfinite(observations.pixels[..., 0])
    shared = np.minimum(seen.sum(axis=1), 4) - 1
    weight = np.maximum(shared, 0).sum(axis=0) / max(len(shared), 1)
    core = np.isin(observations.keypoint_index, observations.skeleton.core_indices)
    order = np.lexsort((np.arange(len(weight)), -weight, ~core))
    selected = [int(c) for c in order if weight[c] > _MIN_SHARED_VIEWS][:_MAX_COLUMNS]
    if not selected:
        selected = np.flatnonzero(seen.any(axis=(0, 1)))[:_MAX_COLUMNS].tolist()
    return np.array(sorted(set(selected)), dtype=int)


def sample_frames(
    n_frames: int, runs: np.ndarray, period_s: float, min_spacing_s: float, max_samples: int
) -> np.ndarray:
    """Return evenly spaced frame indices, at least ``min_spacing_s`` apart and at most ``max_samples`` of them."""
    stride = max(1, round(min_spacing_s / period_s), -(-n_frames // max_samples))
    chosen = [np.arange(start, stop) for start, stop in ranges(n_frames, 1 << 30)]
    every = np.concatenate(chosen) if chosen else np.zeros(0, dtype=int)
    return every[(every - np.searchsorted(runs, runs[every])) % stride == 0]
