"""Selection of the single subject of a recording: at most one detection per view and frame."""

from collections import Counter
from dataclasses import dataclass
from typing import Self

import numpy as np

from posefuse.arrays import ranges
from posefuse.association.common_volume import time_in_common_volume
from posefuse.errors import DetectionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import CHUNK_FRAMES, Detections
from posefuse.model.options.options import Pick
from posefuse.model.tracks import Tracks, TrackState

PERSON = "person_1"
NO_PERSON = (
    "No person was tracked: the views share too few detections, or the cameras do not agree. "
    "`posefuse.inspect_health` shows why."
)
_LARGEST = (
    "`pick='largest'` selects the largest person separately in each view and frame, so views may show different "
    "people. `exclude_camera`, or keypoints with track IDs and `pick='track-id'`, are safer."
)


@dataclass(frozen=True)
class SingleSubject:
    """The single subject of a recording; see :func:`select_subject`.

    Attributes:
        detections: Detections of the recording.
        pick: Which person to select where a view shows several.
        ids: shape (view,): from :func:`longest_track_ids`.
        assigned: shape (frame, view), int32: the subject's detection, -1 without one, if people were tracked to find
            the subject; ``pick`` and ``ids`` are not used then.
        note: how the subject was chosen, if that needs attention.
    """

    detections: Detections
    pick: Pick | None
    ids: np.ndarray
    assigned: np.ndarray | None = None
    note: str = ""

    @classmethod
    def of(cls, detections: Detections, pick: Pick | None) -> Self:
        """Return the subject of a recording."""
        several = bool((detections.people_counts > 1).any())
        return cls(
            detections, pick, longest_track_ids(detections), note=_LARGEST if several and pick == "largest" else ""
        )

    def tracks(self, start: int, stop: int) -> Tracks:
        """Return the subject's detections in a range of frames."""
        if self.assigned is not None:
            return _tracks(self.assigned[start:stop])
        return select_subject(self.detections.frames(start, stop), self.pick, self.ids)


def longest_track_ids(detections: Detections) -> np.ndarray:
    """Return the 2D track identity that each view shows in most frames, shape (view,), int64; -1 without identities.

    The smallest one is returned if several are equally frequent.
    """
    views = detections.n_views
    lengths: list[Counter[int]] = [Counter() for _ in range(views)]
    for start, stop in ranges(detections.n_frames, CHUNK_FRAMES):
        offsets = detections.offsets[start * views : stop * views + 1]
        ids = np.asarray(detections.track_ids[int(offsets[0]) : int(offsets[-1])])
        view_of = np.repeat(np.tile(np.arange(views), stop - start), np.diff(offsets))
        for v, length in enumerate(lengths):
            values, counts = np.unique(ids[(view_of == v) & (ids >= 0)], return_counts=True)
            length.update(dict(zip(values.tolist(), counts.tolist(), strict=True)))
    return np.array([min(own, key=lambda name: (-own[name], name), default=-1) for own in lengths])


def select_subject(detections: Detections, pick: Pick | None, subject_ids: np.ndarray) -> Tracks:
    """Select the subject's detection in each view and frame of a range.

    Args:
        detections: Detections in memory.
        pick: Which person to select where a view shows several: the ``largest``, by the area that the keypoints span,
            or the one with the view's ``track-id``; None raises an error.
        subject_ids: From :func:`longest_track_ids`, for the whole recording.

    Raises:
        DetectionsError: If a view shows several people and ``pick`` is None, or if track identities are requested and a
            view has none.
    """
    counts = detections.people_counts
    chosen = np.where(counts == 1, 0, -1).astype(np.int32)
    crowded = np.argwhere(counts > 1)
    if pick == "track-id":
        chosen = _by_track_id(detections, subject_ids)
    elif len(crowded) and pick is None:
        f, v = crowded[0]
        ways = "`pick='largest'` or `pick='track-id'`" if (subject_ids >= 0).any() else "`pick='largest'`"
        raise DetectionsError(
            f"View {detections.view_names[v]!r} shows {counts[f, v]} people in frame {detections.frame_numbers[f]}. "
            f"In this range, {len(crowded)} {'image shows' if len(crowded) == 1 else 'images show'} several people. "
            f"Select the subject with {ways}, or remove the other people."
        )
    else:
        for f, v in crowded:
            start, stop = detections.offsets[f * detections.n_views + v :][:2]
            chosen[f, v] = np.argmax(_areas(np.asarray(detections.keypoints_px[start:stop])))
    return _tracks(chosen)


def _tracks(chosen: np.ndarray) -> Tracks:
    """Return the tracks of one person who is always active."""
    return Tracks((PERSON,), chosen[:, None, :], np.full((len(chosen), 1), TrackState.ACTIVE, dtype=np.int8))


def lone_detections(detections: Detections) -> SingleSubject:
    """Return a subject with the detections that are alone in their view and frame."""
    ids = np.full(detections.n_views, -1)
    return SingleSubject(
        detections, None, ids, assigned=np.where(detections.people_counts == 1, 0, -1).astype(np.int32)
    )


def longest_subject(rig: CameraRig, detections: Detections, tracks: Tracks) -> SingleSubject:
    """Return the tracked person who stays longest in the common volume of the cameras; of equals, the most detected.

    Args:
        rig: One camera per view.
        detections: Detections of the recording.
        tracks: Everyone's tracks in all frames.

    Raises:
        DetectionsError: If no person was tracked.
    """
    detection = np.asarray(tracks.detection)
    if not detection.shape[1]:
        raise DetectionsError(
            "Views show several people, but no person was tracked, so the subject is unknown. Use `pick='largest'` or "
            "`pick='track-id'`."
        )
    volume = time_in_common_volume(rig, detections, tracks)
    order = np.lexsort((-(detection >= 0).sum(axis=(0, 2)), -volume.share))
    best = int(order[0])
    others = f"; the next of the {len(order)} tracked people {volume.share[order[1]]:.0%}" if len(order) > 1 else ""
    note = (
        f"people = 'one': the subject stays longest in the common volume: {volume.share[best]:.0%} of the time in "
        f"sight of {volume.n_views} cameras{others}. `pick` selects the subject in another way."
    )
    return SingleSubject(
        detections, None, longest_track_ids(detections), assigned=detection[:, best].astype(np.int32), note=note
    )


def _by_track_id(detections: Detections, subject_ids: np.ndarray) -> np.ndarray:
    ids = np.asarray(detections.track_ids)
    without = [name for name, subject in zip(detections.view_names, subject_ids, strict=True) if subject < 0]
    busy = [
        name for name in without if detections.people_counts[:, detections.view_names.index(name)].max(initial=0) > 1
    ]
    if busy:
        raise DetectionsError(
            f"pick = 'track-id', but the people in view {busy[0]!r} have no track IDs. Use `pick='largest'`."
        )
    chosen = np.full((detections.n_frames, detections.n_views), -1, dtype=np.int32)
    for f in range(detections.n_frames):
        for v in range(detections.n_views):
            start, stop = detections.offsets[f * detections.n_views + v :][:2]
            match = np.flatnonzero(ids[start:stop] == subject_ids[v])
            if len(match):
                chosen[f, v] = match[0]
    return chosen


def _areas(keypoints_px: np.ndarray) -> np.ndarray:
    """Return the areas of the boxes around the detected keypoints, shape (row,), px^2; 0 without keypoints."""
    seen = np.isfinite(keypoints_px)
    high = np.where(seen, keypoints_px, -np.inf).max(axis=1)
    low = np.where(seen, keypoints_px, np.inf).min(axis=1)
    sides = np.maximum(high - low, 0.0)
    return sides[:, 0] * sides[:, 1]
