"""Selection of the single subject."""

import numpy as np
import pytest

from posefuse.association import one_subject
from posefuse.association.one_subject import longest_track_ids, select_subject
from posefuse.errors import DetectionsError
from posefuse.model.detections import Detections
from tests.scenes import skeleton_of


def crowd(sizes: list[list[list[float]]], ids: list[int] | None = None) -> Detections:
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


def test_one_person_needs_no_choice():
    assert chosen(crowd([[[5], []], [[], [5]]]), None) == [[0, -1], [-1, 0]]


def test_several_people_need_one():
    with pytest.raises(DetectionsError, match=r"View 'b' shows 2 people in frame 1 .*with --pick largest, or remove"):
        chosen(crowd([[[5], [5]], [[5], [5, 6]]]), None)
    with pytest.raises(DetectionsError, match="--pick largest or --pick track-id"):
        chosen(crowd([[[5], [5]], [[5], [5, 6]]], [1, 1, 1, 1, 2]), None)


def test_choosing_by_size_is_remarked_on():
    assert one_subject.remarks(False, "largest") == one_subject.remarks(True, "track-id") == ()
    assert "may show different people" in one_subject.remarks(True, "largest")[0]


def test_the_largest():
    assert chosen(crowd([[[3, 9, 4], [2]], [[7, 1], []]]), "largest") == [[1, 0], [0, -1]]


def test_people_without_keypoints_are_smallest():
    detections = crowd([[[3, 9], [2]]])
    keypoints = np.array(detections.keypoints_px)
    keypoints[1] = np.nan
    from dataclasses import replace

    assert chosen(replace(detections, keypoints_px=keypoints), "largest") == [[0, 0]]


def test_the_track_id_that_lasts_longest_in_each_view():
    detections = crowd([[[1, 1], [1]], [[1, 1], [1]], [[1], [1]]], ids=[4, 7, 2, 7, 4, 2, 7, 3])
    assert longest_track_ids(detections).tolist() == [7, 2]
    assert chosen(detections, "track-id") == [[1, 0], [0, 0], [0, -1]]


def test_track_ids_must_be_there():
    with pytest.raises(DetectionsError, match="people in view 'a' have no track IDs. Use --pick largest"):
        chosen(crowd([[[1, 1], [1]]]), "track-id")
