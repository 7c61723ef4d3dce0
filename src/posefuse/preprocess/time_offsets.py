"""Correct the time offsets of views: true times, views matched by time, keypoints interpolated to frame times.

At the time of a frame, a view's keypoint lies between two of the view's own frames. It is interpolated linearly between
them if the person is known in both and they are at most two frames apart; otherwise it is missing.
"""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.errors import DetectionsError, MatchError, suggestion
from posefuse.model.detections import Detections
from posefuse.model.options.sync import NEAR_FRAMES, SyncOptions
from posefuse.model.subjects import Subjects
from posefuse.preprocess.start_times import with_start_times
from posefuse.preprocess.timeline import fill_missing_times

_MAX_FRAMES_APART = 2.1


@dataclass(frozen=True, eq=False)
class ShiftedViews:
    """Detections with corrected times.

    Attributes:
        detections: detections with true times, in memory.
        time_s: shape (frame,): the time that each frame represents.
        notes: what was corrected.
    """

    detections: Detections
    time_s: np.ndarray
    notes: tuple[str, ...]

    def with_detections(self, detections: Detections) -> "ShiftedViews":
        """Return the corrected views with other detections of the leading frames."""
        return replace(self, detections=detections, time_s=self.time_s[: detections.n_frames])


def shift_views(detections: Detections, cameras: tuple[str, ...], sync: SyncOptions) -> ShiftedViews:
    """Correct the times of all views, and match each frame with the frame of every view nearest to it in time.

    Args:
        detections: detections, views in the order of the cameras.
        cameras: names of the cameras.
        sync: time offset of each view.

    Raises:
        DetectionsError: if frames have no times.
        MatchError: if ``sync`` names a camera without a view.
    """
    for name in sync.cameras:
        if name not in cameras:
            raise MatchError(f"sync.cameras names {name!r}, which has no view. {suggestion(name, cameras)}")
    everything = detections.frames(0, detections.n_frames)
    stated = np.array(everything.time_s)
    if not np.isfinite(stated).any():
        raise DetectionsError("sync needs times, but the files contain no frame rate. Add `rate_hz`.")
    for v in range(stated.shape[1]):
        stated[:, v] = fill_missing_times(stated[:, v], everything.frame_numbers)
    if sync.are_far_apart(cameras):
        # A new timeline keeps frames that only later views recorded.
        return _realigned(everything, cameras, sync)
    common = np.nanmean(stated, axis=1)
    true = np.stack([stated[:, v] + sync.offset_at(name, stated[:, v]) for v, name in enumerate(cameras)], axis=1)
    source = np.stack([_nearest(common, true[:, v]) for v in range(len(cameras))], axis=1)
    notes = tuple(
        _note(name, true[:, v] - stated[:, v], common) for v, name in enumerate(cameras) if name in sync.cameras
    )
    return ShiftedViews(_rearrange(everything, source, true), common, notes)


def _realigned(everything: Detections, cameras: tuple[str, ...], sync: SyncOptions) -> ShiftedViews:
    """Return views that start seconds apart on a new timeline; its times are those of the view with most frames."""
    moved = with_start_times(replace(everything, view_names=cameras), sync)
    true = np.array(moved.time_s)
    common = np.full(moved.n_frames, np.nan)
    for v in np.argsort(-moved.recorded.sum(axis=0), kind="stable"):
        common = np.where(np.isfinite(common), common, true[:, v])
    period = float(np.median(np.diff(common)))
    offsets = {name: float(sync.offset_at(name, np.array(0.0))) for name in cameras if name in sync.cameras}
    notes = tuple(
        f"Sync: view {name} started {abs(offset):.3f} s {'later' if offset > 0 else 'earlier'}; its keypoints are "
        f"interpolated between its frames to the frame times, {1.0 / period:.4g} per second."
        for name, offset in offsets.items()
    )
    source = np.where(moved.recorded, np.arange(moved.n_frames)[:, None], -1)
    rearranged = replace(_rearrange(moved, source, true), view_names=everything.view_names)
    return ShiftedViews(rearranged, common, notes)


def _note(name: str, offset_s: np.ndarray, common: np.ndarray) -> str:
    period = float(np.median(np.diff(common))) if len(common) > 1 else np.nan
    first, last = offset_s[0] / period, offset_s[-1] / period
    span = f"{first:+.2f}" if abs(first - last) < 0.005 else f"{first:+.2f} to {last:+.2f}"
    return (
        f"Sync: view {name} has a time offset of {span} frames; its keypoints are interpolated between its frames to "
        "the frame times."
    )


def _nearest(frame_s: np.ndarray, view_s: np.ndarray) -> np.ndarray:
    """Return for each frame the view's nearest frame; -1 if it is too far away or nearer to another frame."""
    period = float(np.median(np.diff(frame_s))) if len(frame_s) > 1 else np.inf
    after = np.clip(np.searchsorted(view_s, frame_s), 0, len(view_s) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(view_s[before] - frame_s) <= np.abs(view_s[after] - frame_s), before, after)
    gap = np.abs(view_s[nearest] - frame_s)
    # If two frames have the same nearest frame of the view, the nearer one gets it.
    order = np.lexsort((gap, nearest))
    first = np.ones(len(order), dtype=bool)
    first[1:] = nearest[order][1:] != nearest[order][:-1]
    assigned = np.zeros(len(frame_s), dtype=bool)
    assigned[order[first]] = True
    return np.where(assigned & (gap < 0.75 * period), nearest, -1)


def _rearrange(detections: Detections, source: np.ndarray, true_s: np.ndarray) -> Detections:
    views = np.arange(detections.n_views)
    present = source >= 0
    counts = np.where(present, detections.people_counts[source, views], 0)
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
        recorded=present & detections.recorded[source, views],
        time_s=np.where(present, true_s[source, views], np.nan),
    )


def interpolate_to_frame_times(shifted: ShiftedViews, subjects: Subjects) -> Detections:
    """Interpolate the detections of all people to the frame times.

    Views within a tenth of a frame of the frame time are left as they are.

    Args:
        shifted: detections with corrected times.
        subjects: assignment of these detections to people.
    """
    detections, common = shifted.detections, shifted.time_s
    times = np.asarray(detections.time_s)
    period = float(np.median(np.diff(common))) if len(common) > 1 else np.inf
    rows = subjects.tracks(0, detections.n_frames).rows(detections)
    pixels, confidence = np.array(detections.keypoints_px), np.array(detections.confidence)
    old_pixels, old_confidence = pixels.copy(), confidence.copy()
    for v in range(detections.n_views):
        off = (common - times[:, v]) / period
        for p in range(rows.shape[1]):
            for f in np.flatnonzero((rows[:, p, v] >= 0) & (np.abs(off) > NEAR_FRAMES)):
                row, other, share = _neighbor(rows[:, p, v], times[:, v], int(f), common[f], period)
                if other < 0:
                    pixels[row], confidence[row] = np.nan, np.nan
                    continue
                pixels[row] = (1.0 - share) * old_pixels[row] + share * old_pixels[other]
                # An interpolated keypoint is no more certain than the worse of the two it comes from.
                confidence[row] = np.minimum(old_confidence[row], old_confidence[other])
    frame_times = np.where(np.isfinite(times), common[:, None], np.nan)
    return replace(detections, keypoints_px=pixels, confidence=confidence, time_s=frame_times)


def _neighbor(rows: np.ndarray, times: np.ndarray, f: int, frame_s: float, period: float) -> tuple[int, int, float]:
    """Return the row of a frame, the row on the other side of the frame time (-1 if too far), and its weight."""
    step = 1 if frame_s > times[f] else -1
    for g in (f + step, f + 2 * step):
        if 0 <= g < len(rows) and rows[g] >= 0:
            apart = times[g] - times[f]
            if abs(apart) < _MAX_FRAMES_APART * period and abs(frame_s - times[f]) <= abs(apart):
                return int(rows[f]), int(rows[g]), float((frame_s - times[f]) / apart)
    return int(rows[f]), -1, 0.0
