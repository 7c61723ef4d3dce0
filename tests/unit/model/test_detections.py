"""Detections: ragged columns, ranges, views, skeletons and errors."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import DetectionsError, MatchError
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import find_skeleton
from tests.example_detections import ragged_detections
from tests.scenes import skeleton_of


def people(detections: Detections, frame: int, view: int) -> np.ndarray:
    start, stop = detections.offsets[frame * detections.n_views + view :][:2]
    return np.asarray(detections.keypoints_px)[start:stop]


def test_concatenated_ranges_equal_the_whole(rng):
    whole = ragged_detections(rng)
    parts = list(whole.chunks(4))
    assert [part.n_frames for part in parts] == [4, 2]
    for f in range(6):
        part = parts[f // 4]
        for v in range(3):
            np.testing.assert_array_equal(people(part, f % 4, v), people(whole, f, v))
    assert parts[1].frame_numbers.tolist() == [14, 15]


def test_chunks_are_consecutive_ranges(rng):
    whole = ragged_detections(rng)
    joined = whole.pieces([(0, 2), (3, 6)])
    assert joined.frame_numbers.tolist() == whole.frame_numbers[[0, 1, 3, 4, 5]].tolist()
    for f, of in enumerate((0, 1, 3, 4, 5)):
        for v in range(3):
            np.testing.assert_array_equal(people(joined, f, v), people(whole, of, v))


def test_selected_views_keep_their_people(rng):
    whole = ragged_detections(rng)
    chosen = whole.views(["view_2", "view_0"])
    for f in range(6):
        np.testing.assert_array_equal(people(chosen, f, 0), people(whole, f, 2))
        np.testing.assert_array_equal(people(chosen, f, 1), people(whole, f, 0))
    with pytest.raises(MatchError, match="No view 'view2'.*Did you mean 'view_2'"):
        whole.views(["view2"])


def test_rows_have_their_frame_and_view(rng):
    whole = ragged_detections(rng)
    for f in range(6):
        for v in range(3):
            for row in range(*whole.offsets[f * 3 + v :][:2]):
                assert whole.place_of_row(row) == (10 + f, f"view_{v}")


def test_equality_is_by_content(rng):
    one = ragged_detections(np.random.default_rng(1))
    assert one == ragged_detections(np.random.default_rng(1))
    assert one != replace(one, rate_hz=25.0)
    assert one != ragged_detections(np.random.default_rng(2))


def test_dense_arrays_round_trip(rng):
    pixels = rng.uniform(0, 100, (5, 2, 17, 2))
    pixels[1, 0, 3] = np.nan
    detections = Detections.from_dense(skeleton_of(17), ("a", "b"), pixels, rate_hz=25.0)
    dense, confidence = detections.dense()
    np.testing.assert_array_equal(dense, pixels)
    assert np.isnan(confidence).all()
    np.testing.assert_allclose(detections.time_s[:, 1], np.arange(5) / 25.0)


def test_dense_holds_one_person(rng):
    crowded = ragged_detections(rng)
    with pytest.raises(DetectionsError, match=r"View 'view_\d' has \d people in frame 1\d"):
        crowded.dense()


def test_without_a_rate_times_are_missing(rng):
    detections = Detections.from_dense(skeleton_of(17), ("a",), np.zeros((3, 1, 17, 2)))
    assert np.isnan(detections.time_s).all()
    timed = detections.with_rate(50.0)
    np.testing.assert_allclose(timed.time_s[:, 0], [0, 0.02, 0.04])
    assert timed.rate_hz == 50.0


def test_mapping_to_another_skeleton(rng):
    coco, body = find_skeleton("coco_17"), find_skeleton("body_20")
    pixels = rng.uniform(0, 100, (2, 1, 17, 2))
    confidence = rng.uniform(0.1, 1, (2, 1, 17))
    pixels[1, 0, coco.index("left_hip")] = np.nan
    mapped = Detections.from_dense(coco, ("a",), pixels, confidence).to_skeleton(body)
    new, trust = mapped.dense()
    np.testing.assert_array_equal(new[..., body.index("nose"), :], pixels[..., coco.index("nose"), :])
    hips = [coco.index("left_hip"), coco.index("right_hip")]
    np.testing.assert_allclose(new[0, 0, body.index("mid_hip")], pixels[0, 0, hips].mean(axis=0))
    assert trust[0, 0, body.index("mid_hip")] == confidence[0, 0, hips].min()
    assert np.isnan(new[1, 0, body.index("mid_hip")]).all()
    assert np.isnan(
        Detections.from_dense(body, ("a",), new).to_skeleton(find_skeleton("h36m_17")).dense()[0][0, 0, 7]
    ).all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"confidence": np.zeros((2, 4))}, ["confidence", "row, keypoint", "got an array of shape (2, 4)"]),
        ({"time_s": np.zeros((6, 2))}, ["time_s", "(6, 3)", "(6, 2)"]),
        ({"view_names": ("a", "a", "b")}, ["unique"]),
        ({"frame_numbers": [1, 2, 2, 3, 4, 5]}, ["must increase", "2 is followed by 2"]),
        ({"rate_hz": -1.0}, ["rate_hz must be positive"]),
    ],
)
def test_arrays_of_other_shapes_are_refused(changes, words, rng):
    with pytest.raises(DetectionsError) as error:
        replace(ragged_detections(rng), **changes)
    for word in words:
        assert word in str(error.value)


def test_infinite_values_are_refused_with_their_index(rng):
    whole = ragged_detections(rng)
    keypoints = np.array(whole.keypoints_px)
    row = int(whole.offsets[3 * 3 + 1])
    frame, view = whole.place_of_row(row)
    keypoints[row, 2, 1] = np.inf
    with pytest.raises(DetectionsError, match=f"view '{view}', frame {frame}, contains an infinite"):
        replace(whole, keypoints_px=keypoints)


def test_views_without_the_frame_have_no_people(rng):
    whole = ragged_detections(rng)
    recorded = np.zeros((6, 3), dtype=bool)
    with pytest.raises(DetectionsError, match="not recorded"):
        replace(whole, recorded=recorded)
