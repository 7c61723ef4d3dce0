"""One frame of a recording."""

import pickle
from dataclasses import fields

import numpy as np
import pytest

from posefuse.errors import DetectionsError
from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.skeleton.skeletons import shipped_skeleton


def test_frame_of_a_recording_holds_its_people(rng):
    pixels = rng.uniform(0, 100, (4, 3, 17, 2))
    detections = Detections.from_dense(shipped_skeleton("coco_17"), ("a", "b", "c"), pixels, rate_hz=10.0)
    frame = Frame.of(detections, 2)
    np.testing.assert_array_equal(frame.keypoints_px, pixels[2])
    np.testing.assert_array_equal(frame.view, [0, 1, 2])
    np.testing.assert_allclose(frame.time_s, 0.2)
    assert frame.number == 2
    np.testing.assert_array_equal(frame.rows_of(1), [1])


def test_people_of_each_view_are_put_in_rows(rng):
    pixels = [rng.uniform(0, 100, (n, 5, 2)) for n in (2, 0, 1)]
    frame = Frame.of_people(pixels, [np.ones((n, 5)) for n in (2, 0, 1)], 1.5, [[7, 8], [], [9]], number=3)
    np.testing.assert_array_equal(frame.view, [0, 0, 2])
    np.testing.assert_array_equal(frame.track_ids, [7, 8, 9])
    np.testing.assert_array_equal(frame.rows_of(0), [0, 1])
    assert len(frame.rows_of(1)) == 0
    np.testing.assert_array_equal(frame.keypoints_px[2], pixels[2][0])


def test_views_must_have_the_same_keypoints(rng):
    with pytest.raises(DetectionsError, match="differ in the number of keypoints"):
        Frame.of_people([np.zeros((1, 5, 2)), np.zeros((1, 4, 2))], [np.ones((1, 5)), np.ones((1, 4))], 0.0)


def test_infinite_pixels_are_refused():
    with pytest.raises(DetectionsError, match="infinite"):
        Frame.of_people([np.full((1, 5, 2), np.inf)], [np.ones((1, 5))], 0.0)


def test_frame_may_have_no_people():
    frame = Frame.of_people([np.empty((0, 17, 2)), []], [np.empty((0, 17)), []], 0.0)
    assert len(frame.view) == 0
    assert frame.keypoints_px.shape == (0, 17, 2)


def test_view_without_this_frame_is_not_recorded(rng):
    pixels = rng.uniform(0, 100, (1, 5, 2))
    frame = Frame.of_people([pixels, None, np.empty((0, 5, 2))], time_s=[0.1, np.nan, 0.11])
    np.testing.assert_array_equal(frame.recorded, [True, False, True])
    np.testing.assert_array_equal(frame.view, [0])
    np.testing.assert_allclose(frame.time_s, [0.1, np.nan, 0.11])
    assert np.isnan(frame.confidence).all()
    assert not Frame.of_people([None, None], time_s=0.5).recorded.any()


def test_confidences_and_ids_of_a_missing_view_are_not_used(rng):
    people = rng.uniform(0, 100, (2, 5, 2))
    frame = Frame.of_people([people, None], [np.ones((2, 5)), np.ones((3, 5))], 0.5, [[7, 8], [9, 10, 11]])
    np.testing.assert_array_equal(frame.recorded, [True, False])
    np.testing.assert_array_equal(frame.view, [0, 0])
    np.testing.assert_array_equal(frame.track_ids, [7, 8])


def test_frame_without_time_or_views_is_an_error_with_a_remedy(rng):
    with pytest.raises(DetectionsError, match=r"Frame 7 has no time.*time_s in seconds"):
        Frame.of_people([np.zeros((1, 5, 2))], [np.ones((1, 5))], number=7)
    with pytest.raises(DetectionsError, match=r"has no view.*one array of keypoints per camera"):
        Frame.of_people([], [], 0.0)
    with pytest.raises(DetectionsError, match=r"one per view \(2\); got shape \(3,\)"):
        Frame.of_people([None, None], time_s=[0.0, 0.1, 0.2])


def test_boxes_contain_the_keypoints_of_each_detection():
    keypoints_px = np.array([[[1.0, 8.0], [5.0, 2.0], [np.nan, np.nan]], np.full((3, 2), np.nan)])
    frame = Frame.of_people([keypoints_px], time_s=0.0)
    np.testing.assert_array_equal(frame.boxes_px, [[1.0, 2.0, 5.0, 8.0], [np.nan] * 4])
    assert Frame.of_people([np.empty((0, 3, 2))], time_s=0.0).boxes_px.shape == (0, 4)


def test_unpickled_frame_has_the_layout_for_which_kernels_are_compiled():
    frame = Frame.of_people([np.zeros((1, 3, 2)), np.ones((2, 3, 2))], time_s=0.5, number=7)
    again = pickle.loads(pickle.dumps(frame))
    assert not again.keypoints_px.flags.writeable
    assert not again.confidence.flags.writeable
    for field in fields(Frame):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(frame, field.name))
