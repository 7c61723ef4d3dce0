"""What the detections of a recording tell of its health: one subject or several as columns of tracked points."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections, with_lacking_times
from posefuse.model.tracks import Tracks
from posefuse.skeleton.skeletons import Skeleton

_MOST_COLUMNS = 52
_FEWEST_SEEN = 0.02


@dataclass(frozen=True, eq=False)
class Evidence:
    """Tracked image points of some frames of a recording, in memory.

    Attributes:
        rig: a camera a view, in the views' order.
        skeleton: of the keypoints.
        pixels: shape (frame, view, column, 2), NaN where not detected; a column is a keypoint of a person.
        confidence: shape (frame, view, column), NaN where not detected, 1 where the detector gives none.
        time_s: shape (frame, view): when each view says it took the frame; finite.
        frame_numbers: shape (frame,).
        runs: shape (frame,), int: which consecutive piece of the recording the frame is of.
        keypoint: shape (column,), int: of the skeleton.
        partner: shape (column,), int: the same person's other side, itself where there is none.
        period_s: between frames.
        trusts: whether confidences are between 0 and 1 and differ, so that they may say something.
        timed: whether the files say how long a frame lasts; otherwise ``period_s`` is made up.
    """

    rig: CameraRig
    skeleton: Skeleton
    pixels: np.ndarray
    confidence: np.ndarray
    time_s: np.ndarray
    frame_numbers: np.ndarray
    runs: np.ndarray
    keypoint: np.ndarray
    partner: np.ndarray
    period_s: float
    trusts: bool
    timed: bool

    @property
    def n_views(self) -> int:
        """Number of views."""
        return self.pixels.shape[1]

    @property
    def frame_time_s(self) -> np.ndarray:
        """Shape (frame,): when frames are, in the mean over views."""
        return self.time_s.mean(axis=1)

    def columns(self, chosen: np.ndarray) -> "Evidence":
        """The evidence of some columns; a partner that is not among them is forgotten."""
        place = np.full(len(self.keypoint), -1)
        place[chosen] = np.arange(len(chosen))
        partner = place[self.partner[chosen]]
        return replace(
            self,
            pixels=self.pixels[:, :, chosen],
            confidence=self.confidence[:, :, chosen],
            keypoint=self.keypoint[chosen],
            partner=np.where(partner >= 0, partner, np.arange(len(chosen))),
        )


def gather(rig: CameraRig, detections: Detections, tracks: Tracks, starts: tuple[int, ...] = (0,)) -> Evidence:
    """The evidence of a recording, or of pieces of it.

    Args:
        rig: a camera a view.
        detections: in memory.
        tracks: whose detection is whose, of the same frames.
        starts: the first frame of each consecutive piece, counted in ``detections``.
    """
    rows = tracks.rows(detections)
    n_frames, n_people, n_views = rows.shape
    n_keypoints = len(detections.skeleton)
    shape = (n_frames, n_people, n_views, n_keypoints)
    there = rows >= 0
    pixels, confidence = np.full((*shape, 2), np.nan), np.full(shape, np.nan)
    pixels[there] = np.asarray(detections.keypoints_px)[rows[there]]
    confidence[there] = np.asarray(detections.confidence)[rows[there]]
    pixels = np.moveaxis(pixels, 2, 1).reshape(n_frames, n_views, n_people * n_keypoints, 2)
    confidence = np.moveaxis(confidence, 2, 1).reshape(pixels.shape[:3])
    confidence, trusts = _usable(pixels, confidence)
    time_s, period_s, timed = _times(detections)
    person = np.repeat(np.arange(n_people), n_keypoints)
    runs = np.searchsorted(np.array(starts), np.arange(n_frames), side="right") - 1
    everything = Evidence(
        rig=rig,
        skeleton=detections.skeleton,
        pixels=pixels,
        confidence=confidence,
        time_s=time_s,
        frame_numbers=detections.frame_numbers,
        runs=runs,
        keypoint=np.tile(np.arange(n_keypoints), n_people),
        partner=person * n_keypoints + np.tile(detections.skeleton.mirror, n_people),
        period_s=period_s,
        trusts=trusts,
        timed=timed,
    )
    return everything.columns(_telling(everything))


def _usable(pixels: np.ndarray, confidence: np.ndarray) -> tuple[np.ndarray, bool]:
    seen = np.isfinite(pixels).all(axis=-1)
    known = confidence[seen & np.isfinite(confidence)]
    trusts = bool(len(known)) and known.min() >= 0.0 and known.max() <= 1.001 and float(np.std(known)) > 1e-3
    given = np.where(np.isfinite(confidence), confidence, 1.0)
    return np.where(seen, given, np.nan), trusts


def _times(detections: Detections) -> tuple[np.ndarray, float, bool]:
    """Times of all frames in all views without gaps, the period, and whether the files say it."""
    numbers = np.asarray(detections.frame_numbers, dtype=float)
    times = np.array(detections.time_s, dtype=float)
    known = np.isfinite(times).sum(axis=0)
    timed = detections.rate_hz is not None or bool((known > 1).all())
    rate = detections.rate_hz or 25.0
    for v in range(times.shape[1]):
        if known[v] > 1:
            times[:, v] = with_lacking_times(times[:, v], detections.frame_numbers)
        else:
            times[:, v] = numbers / rate
    steps = np.diff(times, axis=0) / np.diff(numbers)[:, None]
    return times, float(np.median(steps)) if len(steps) else 1.0 / rate, timed


def _telling(evidence: Evidence) -> np.ndarray:
    """Columns that several views see now and then, those seen most if there are many, with their partners."""
    seen = np.isfinite(evidence.pixels[..., 0])
    together = np.minimum(seen.sum(axis=1), 4) - 1
    weight = np.maximum(together, 0).mean(axis=0)
    core = np.isin(evidence.keypoint, evidence.skeleton.core_indices)
    order = np.lexsort((np.arange(len(weight)), -weight, ~core))
    kept = [int(c) for c in order if weight[c] > _FEWEST_SEEN][:_MOST_COLUMNS]
    if not kept:
        kept = np.flatnonzero(seen.any(axis=(0, 1)))[:_MOST_COLUMNS].tolist()
    return np.array(sorted(set(kept)), dtype=int)
