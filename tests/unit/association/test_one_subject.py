"""Selection of the single subject."""

import numpy as np
import pytest

from posefuse.association.one_subject import SingleSubject, longest_subject, longest_track_ids, select_subject
from posefuse.errors import DetectionsError
from posefuse.model.detections import Detections
from posefuse.model.tracks import Tracks, TrackState
from tests.scenes import ring, skeleton_of


def detections_of_sizes(sizes: list[list[list[float]]], ids: list[int] | None = None) -> Detections:
    """Return detections given the sizes of the people in each frame and view, in px."""
    cells = [people for frame in sizes for people in frame]
    rows = [np.array([[0.0, 0.0], [size, size]]) for people in cells for size in people]
    counts = [len(people) for people in cells]
    return Detections(
        skeleton=skeleton_of(2),
        view_names=("a", "b"),
        frame_numbers=np.arange(len(sizes)),
        time_s=np.zeros((len(sizes), 2)),
        offsets=np.concatenate([[0], np.cumsum(counts)]),
        keypoints_px=np.array(rows).reshape(-1, 2, 2),
        confidence=np.ones((len(rows), 2)),
        recorded=np.ones((len(sizes), 2), dtype=bool),
        track_ids=np.full(len(rows), -1) if ids is None else np.array(ids),
    )


def chosen(detections: Detections, pick) -> list[list[int]]:
    return select_subject(detections, pick, longest_track_ids(detections)).detection[:, 0].tolist()


def test_single_person_needs_no_selection():
    assert chosen(detections_of_sizes([[[5], []], [[], [5]]]), None) == [[0, -1], [-1, 0]]


def test_several_people_need_a_selection():
    with pytest.raises(DetectionsError, match=r"View 'b' shows 2 people in frame 1\. .*with `pick='largest'`, or"):
        chosen(detections_of_sizes([[[5], [5]], [[5], [5, 6]]]), None)
    with pytest.raises(DetectionsError, match="`pick='largest'` or `pick='track-id'`"):
        chosen(detections_of_sizes([[[5], [5]], [[5], [5, 6]]], [1, 1, 1, 1, 2]), None)


def test_choice_by_size_has_a_note_if_a_view_shows_several_people():
    alone, several = detections_of_sizes([[[5], []]]), detections_of_sizes([[[5], [5, 6]]], [1, 1, 2])
    assert SingleSubject.of(alone, "largest").note == SingleSubject.of(several, "track-id").note == ""
    assert "may show different people" in SingleSubject.of(several, "largest").note


def test_longest_subject_is_the_one_whom_both_views_see():
    detections = detections_of_sizes([[[1, 1], [1]], [[1, 1], [1, 1]], [[1], []]])
    # Person a: frames 0 and 1 in one view; person b: five detections.
    rows = np.array([[[0, -1], [1, 0]], [[0, -1], [1, 1]], [[-1, -1], [0, -1]]], dtype=np.int32)
    tracks = Tracks(("a", "b"), rows, np.full((3, 2), TrackState.ACTIVE, dtype=np.int8))
    subject = longest_subject(ring(2), detections, tracks)
    assert subject.tracks(0, 3).person_ids == ("person_1",)
    assert subject.tracks(0, 3).detection[:, 0].tolist() == rows[:, 1].tolist()
    assert subject.tracks(1, 2).detection[:, 0].tolist() == [[1, 1]]
    assert "stays longest in the common volume" in subject.note
    with pytest.raises(DetectionsError, match="no person was tracked.*`pick='largest'`"):
        longest_subject(ring(2), detections, Tracks((), rows[:, :0], np.zeros((3, 0), dtype=np.int8)))


def test_selects_the_largest_person():
    assert chosen(detections_of_sizes([[[3, 9, 4], [2]], [[7, 1], []]]), "largest") == [[1, 0], [0, -1]]


def test_people_without_keypoints_are_smallest():
    detections = detections_of_sizes([[[3, 9], [2]]])
    keypoints = np.array(detections.keypoints_px)
    keypoints[1] = np.nan
    from dataclasses import replace

    assert chosen(replace(detections, keypoints_px=keypoints), "largest") == [[0, 0]]


def test_selects_the_longest_track_id_of_each_view():
    detections = detections_of_sizes([[[1, 1], [1]], [[1, 1], [1]], [[1], [1]]], ids=[4, 7, 2, 7, 4, 2, 7, 3])
    assert longest_track_ids(detections).tolist() == [7, 2]
    assert chosen(detections, "track-id") == [[1, 0], [0, 0], [0, -1]]


def test_raises_if_track_ids_are_missing():
    with pytest.raises(DetectionsError, match="people in view 'a' have no track IDs. Use `pick='largest'`"):
        chosen(detections_of_sizes([[[1, 1], [1]]]), "track-id")
