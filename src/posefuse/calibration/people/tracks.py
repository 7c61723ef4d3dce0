"""The 2D tracks of each view, before anything is known about the cameras.

:mod:`posefuse.preprocess.link_detections` links detections over time; :mod:`.identities` joins the short tracks when
the cameras are known.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.people.views import PeopleViews, ViewTracks
from posefuse.errors import DetectionsError
from posefuse.model.cameras import Camera
from posefuse.model.detections import Detections
from posefuse.preprocess.link_detections import link_rows
from posefuse.preprocess.timeline import fill_missing_times
from posefuse.skeleton.skeletons import Skeleton

MOST_TRACKS = 32
"""Most tracks of a view; the ones with the most keypoints are kept."""
MOST_FRAMES = 7200
"""Most frames that are used of a recording; longer ones are sampled in pieces."""
_PIECES = 6
_ASSUMED_RATE_HZ = 30.0
_STILLS_STEP_S = 1.0
_PICTURE_STEP_S = 60.0
_MIN_LINKED = 0.2
_MIN_TRACK_S = 0.5
_MIN_TRACK_FRAMES = 5


@dataclass(frozen=True, eq=False)
class _Rows:
    """Hold the detections of one view.

    Attributes:
        time_s: shape (frame,): times of the frames that the view has.
        starts: shape (frame + 1,): first row of each frame.
        keypoints_px: shape (row, keypoint, 2).
        confidence: shape (row, keypoint).
        ids: shape (row,): the detector's identities.
    """

    time_s: np.ndarray
    starts: np.ndarray
    keypoints_px: np.ndarray
    confidence: np.ndarray
    ids: np.ndarray

    @property
    def frame(self) -> np.ndarray:
        """Shape (row,): frame of each row."""
        return np.repeat(np.arange(len(self.time_s)), np.diff(self.starts))


def tracks_in_views(
    detections: Detections, cameras: Sequence[Camera], focal_known: Sequence[bool] | bool = True
) -> PeopleViews:
    """Return the 2D tracks of every view.

    If no view ever shows more than one detection, each view has one track. If the frames are more than a second apart,
    or hardly any detection can be linked to another frame, nothing is linked, and :attr:`PeopleViews.tracked` is False.
    The times of such pictures without timestamps are only numbers that lie far apart.

    Args:
        detections: of all views; their times need not agree.
        cameras: one per view, in the order of the views.
        focal_known: whether the focal length of each camera is known.

    Raises:
        DetectionsError: if the numbers of views and cameras differ, or no view has detections.
    """
    if len(cameras) != detections.n_views:
        raise DetectionsError(
            f"The keypoints have {detections.n_views} views, but {len(cameras)} cameras were specified. Specify one "
            "camera per view."
        )
    known = [focal_known] * len(cameras) if isinstance(focal_known, bool) else list(focal_known)
    sampled, notes = _sample(detections)
    several = bool((sampled.people_counts > 1).any())
    time_s, assumed = _view_times(sampled)
    by_view = [_rows_of_view(sampled, v, time_s[:, v]) for v in range(sampled.n_views)]
    if not any(len(rows.ids) for rows in by_view):
        raise DetectionsError("No person was detected in any view.")
    slots = [_slots(rows, sampled.skeleton) if several else _places(rows) for rows in by_view]
    tracked = not several or (_median_step_s(by_view) < _STILLS_STEP_S and _linked_share(slots) > _MIN_LINKED)
    if assumed and tracked:
        notes = (*notes, f"The keypoints have no times: {_ASSUMED_RATE_HZ:g} frames per second are assumed.")
    if not tracked:
        notes = (*notes, "People are not linked over time: the frames are unrelated pictures.")
        slots = [_places(rows) for rows in by_view]
        if assumed:
            by_view = [replace(rows, time_s=rows.time_s * _ASSUMED_RATE_HZ * _PICTURE_STEP_S) for rows in by_view]
    views = [
        _view_tracks(rows, slot, camera, focal)
        for rows, slot, camera, focal in zip(by_view, slots, cameras, known, strict=True)
    ]
    return PeopleViews(sampled.skeleton, tuple(views), tracked=tracked, notes=notes)


def _linked_share(slots: Sequence[np.ndarray]) -> float:
    """Return the share of the detections that belong to a track."""
    return float((np.concatenate(slots) >= 0).mean())


def _sample(detections: Detections) -> tuple[Detections, tuple[str, ...]]:
    """Return the recording in memory, or evenly distributed pieces of a long one."""
    n = detections.n_frames
    if n <= MOST_FRAMES:
        return detections.frames(0, n), ()
    length = MOST_FRAMES // _PIECES
    first = np.linspace(0, n - length, _PIECES).astype(int)
    note = f"{MOST_FRAMES} of {n} frames are used, in {_PIECES} pieces."
    return detections.pieces([(int(start), int(start) + length) for start in first]), (note,)


def _view_times(detections: Detections) -> tuple[np.ndarray, bool]:
    """Return the time of each frame in each view, shape (frame, view), and whether a rate was assumed."""
    times = np.array(detections.time_s)
    by_number = np.asarray(detections.frame_numbers) / (detections.rate_hz or _ASSUMED_RATE_HZ)
    assumed = False
    for v in range(times.shape[1]):
        if np.isfinite(times[:, v]).sum() > 1:
            times[:, v] = fill_missing_times(times[:, v], detections.frame_numbers)
        else:
            times[:, v] = by_number
            assumed |= detections.rate_hz is None
    return times, assumed


def _rows_of_view(detections: Detections, view: int, time_s: np.ndarray) -> _Rows:
    """Return the rows of one view; frames that the view lacks are left out."""
    name = detections.view_names[view]
    of_view = detections.views([name])
    kept = np.flatnonzero(of_view.recorded[:, 0])
    counts = of_view.people_counts[kept, 0]
    confidence = np.asarray(of_view.confidence)
    return _Rows(
        time_s=time_s[kept],
        starts=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        keypoints_px=np.ascontiguousarray(of_view.keypoints_px, dtype=np.float64),
        confidence=np.where(np.isfinite(confidence), confidence, 1.0),
        ids=np.ascontiguousarray(of_view.track_ids),
    )


def _median_step_s(by_view: Sequence[_Rows]) -> float:
    steps = np.concatenate([np.diff(rows.time_s) for rows in by_view])
    return float(np.median(steps)) if len(steps) else np.inf


def _places(rows: _Rows) -> np.ndarray:
    """Return the index of each row in its frame, -1 beyond the largest number of tracks."""
    place = np.arange(len(rows.ids)) - rows.starts[rows.frame]
    return np.where(place < MOST_TRACKS, place, -1)


def _slots(rows: _Rows, skeleton: Skeleton) -> np.ndarray:
    """Return the track of each row, the ones with the most keypoints first, -1 where it has none."""
    track = link_rows(rows.starts, rows.time_s, rows.keypoints_px, rows.ids, skeleton)
    n_tracks = int(track.max(initial=-1)) + 1
    linked = track >= 0
    frame, of_track = rows.frame[linked], track[linked]
    first, last = np.full(n_tracks, np.inf), np.full(n_tracks, -np.inf)
    np.minimum.at(first, of_track, rows.time_s[frame])
    np.maximum.at(last, of_track, rows.time_s[frame])
    frames = np.bincount(of_track, minlength=n_tracks)
    found = np.isfinite(rows.keypoints_px[linked, :, 0]).sum(axis=1)
    weight = np.bincount(of_track, weights=found, minlength=n_tracks)
    long = (last - first >= _MIN_TRACK_S - 1e-9) & (frames >= _MIN_TRACK_FRAMES)
    order = [t for t in np.argsort(-weight, kind="stable") if long[t]][:MOST_TRACKS]
    slot = np.full(n_tracks + 1, -1)
    slot[order] = np.arange(len(order))
    return slot[np.maximum(track, -1)]


def _view_tracks(rows: _Rows, slot: np.ndarray, camera: Camera, focal_known: bool) -> ViewTracks:
    """Return the rows by frame and track."""
    n_slots = max(int(slot.max(initial=-1)) + 1, 1)
    shape = (len(rows.time_s), n_slots, rows.keypoints_px.shape[1])
    keypoints_px, confidence = np.full((*shape, 2), np.nan), np.full(shape, np.nan)
    used = slot >= 0
    place = rows.frame[used], slot[used]
    keypoints_px[place] = rows.keypoints_px[used]
    confidence[place] = np.where(np.isfinite(rows.keypoints_px[used, :, 0]), rows.confidence[used], np.nan)
    return ViewTracks(camera, focal_known, rows.time_s, keypoints_px, confidence)
