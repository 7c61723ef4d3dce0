"""Views out of step brought into step: true times, frames put beside those of the same time, points in between.

What a view showed at a frame's time lies between two of its frames: a keypoint is put on the straight line between
them, where the same person's is known in both and no more than two frames are between. What is not, is missing.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.errors import DetectionsError, MatchError, suggestion
from posefuse.model.detections import Detections
from posefuse.model.options.sync import NEAR_FRAMES, SyncOptions
from posefuse.model.tracks import Tracks
from posefuse.preprocess.timeline import fill_missing_times

_MOST_FRAMES = 2.1


@dataclass(frozen=True, eq=False)
class InStep:
    """Detections in step.

    Attributes:
        detections: with true times, in memory.
        time_s: shape (frame,): what each frame stands for.
        notes: what was done.
    """

    detections: Detections
    time_s: np.ndarray
    notes: tuple[str, ...]


def in_step(detections: Detections, cameras: tuple[str, ...], sync: SyncOptions) -> InStep:
    """The detections with true times, each view's frames beside those that the others took nearest to them.

    Args:
        detections: views in the cameras' order.
        cameras: names of the cameras.
        sync: how late views are.

    Raises:
        DetectionsError: if frames have no times.
        MatchError: if a camera is named that is not there.
    """
    for name in sync.cameras:
        if name not in cameras:
            raise MatchError(f"sync.cameras names {name!r}, which has no view. {suggestion(name, cameras)}")
    everything = detections.frames(0, detections.n_frames)
    said = np.array(everything.time_s)
    if not np.isfinite(said).any():
        raise DetectionsError("sync needs times, and the files give no frame rate. Add --rate-hz.")
    for v in range(said.shape[1]):
        said[:, v] = fill_missing_times(said[:, v], everything.frame_numbers)
    common = np.nanmean(said, axis=1)
    true = np.stack([said[:, v] + sync.offset_at(name, said[:, v]) for v, name in enumerate(cameras)], axis=1)
    source = np.stack([_nearest(common, true[:, v]) for v in range(len(cameras))], axis=1)
    notes = tuple(
        _note(name, true[:, v] - said[:, v], common) for v, name in enumerate(cameras) if name in sync.cameras
    )
    return InStep(_rearranged(everything, source, true), common, notes)


def _note(name: str, late_s: np.ndarray, common: np.ndarray) -> str:
    period = float(np.median(np.diff(common))) if len(common) > 1 else np.nan
    first, last = late_s[0] / period, late_s[-1] / period
    span = f"{first:+.2f}" if abs(first - last) < 0.005 else f"{first:+.2f} to {last:+.2f}"
    return f"Sync: view {name} is {span} frames late; its keypoints are taken at the frames' times, between its frames."


def _nearest(wanted: np.ndarray, times: np.ndarray) -> np.ndarray:
    """For each frame the view's frame nearest in time, -1 where there is none within a frame or another has it."""
    period = float(np.median(np.diff(wanted))) if len(wanted) > 1 else np.inf
    after = np.clip(np.searchsorted(times, wanted), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(times[before] - wanted) <= np.abs(times[after] - wanted), before, after)
    gap = np.abs(times[nearest] - wanted)
    # Of two frames that one is nearest to, it is the nearer one's.
    taken = np.lexsort((gap, nearest))
    first = np.ones(len(taken), dtype=bool)
    first[1:] = nearest[taken][1:] != nearest[taken][:-1]
    own = np.zeros(len(wanted), dtype=bool)
    own[taken[first]] = True
    return np.where(own & (gap < 0.75 * period), nearest, -1)


def _rearranged(detections: Detections, source: np.ndarray, true_s: np.ndarray) -> Detections:
    views = np.arange(detections.n_views)
    there = source >= 0
    counts = np.where(there, detections.people_counts[source, views], 0)
    starts = detections.offsets[:-1].reshape(detections.n_frames, detections.n_views)[source, views]
    offsets = np.concatenate([[0], np.cumsum(counts.ravel())])
    rows = np.repeat(starts.ravel() - offsets[:-1], counts.ravel()) + np.arange(offsets[-1])
    return replace(
        detections,
        offsets=offsets,
        keypoints_px=np.asarray(detections.keypoints_px)[rows],
        confidence=np.asarray(detections.confidence)[rows],
        track_ids=np.asarray(detections.track_ids)[rows],
        depth=None if detections.depth is None else np.asarray(detections.depth)[rows],
        sigma_px=None if detections.sigma_px is None else np.asarray(detections.sigma_px)[rows],
        recorded=there & detections.recorded[source, views],
        time_s=np.where(there, true_s[source, views], np.nan),
    )


def at_frame_times(step: InStep, tracks: Tracks) -> Detections:
    """The detections of followed people as they were at the frames' times.

    Views that are within a tenth of a frame of the frame's time are left as they are.

    Args:
        step: what :func:`in_step` made.
        tracks: whose detection is whose, of the same frames.
    """
    detections, common = step.detections, step.time_s
    times = np.asarray(detections.time_s)
    period = float(np.median(np.diff(common))) if len(common) > 1 else np.inf
    rows = tracks.rows(detections)
    pixels, confidence = np.array(detections.keypoints_px), np.array(detections.confidence)
    was_pixels, was_confidence = pixels.copy(), confidence.copy()
    for v in range(detections.n_views):
        off = (common - times[:, v]) / period
        for p in range(rows.shape[1]):
            for f in np.flatnonzero((rows[:, p, v] >= 0) & (np.abs(off) > NEAR_FRAMES)):
                row, other, share = _neighbour(rows[:, p, v], times[:, v], int(f), common[f], period)
                if other < 0:
                    pixels[row], confidence[row] = np.nan, np.nan
                    continue
                pixels[row] = (1.0 - share) * was_pixels[row] + share * was_pixels[other]
                # Where a straight line stands in for a motion, less is known than where something was seen.
                confidence[row] = np.minimum(was_confidence[row], was_confidence[other])
    settled = np.where(np.isfinite(times), common[:, None], np.nan)
    return replace(detections, keypoints_px=pixels, confidence=confidence, time_s=settled)


def _neighbour(rows: np.ndarray, times: np.ndarray, f: int, wanted: float, period: float) -> tuple[int, int, float]:
    """The row of a frame, the row on the other side of the wanted time (-1 if too far), and where between."""
    way = 1 if wanted > times[f] else -1
    for g in (f + way, f + 2 * way):
        if 0 <= g < len(rows) and rows[g] >= 0:
            apart = times[g] - times[f]
            if abs(apart) < _MOST_FRAMES * period and abs(wanted - times[f]) <= abs(apart):
                return int(rows[f]), int(rows[g]), float((wanted - times[f]) / apart)
    return int(rows[f]), -1, 0.0
