"""What a detector returns is checked before it is used."""

import numpy as np
import pytest

from posefuse.detection.detector import FrameDetections, parse_detections
from posefuse.errors import DetectorError

PERSON = np.array([[1.0, 2.0, 0.5], [3.0, 4.0, 0.9]])


def test_one_person_needs_no_axis_of_people():
    found = parse_detections(PERSON, 2, "It")
    assert found.keypoints_px.tolist() == [[[1.0, 2.0], [3.0, 4.0]]]
    assert found.confidence.tolist() == [[0.5, 0.9]]
    assert found.boxes_px is None


@pytest.mark.parametrize("nothing", [None, [], (), np.empty((0, 2, 3))])
def test_an_image_without_people_is_empty(nothing):
    assert parse_detections(nothing, 2, "It").keypoints_px.shape == (0, 2, 2)


def test_a_missing_coordinate_makes_the_keypoint_missing():
    rows = np.array([PERSON, PERSON, PERSON])
    rows[0, 0, 1] = np.nan
    rows[1, :, 0] = np.nan
    found = parse_detections((rows, np.arange(12.0).reshape(3, 4)), 2, "It")
    assert len(found) == 2
    assert np.isnan(found.keypoints_px[0, 0]).all()
    assert np.isnan(found.confidence[0, 0])
    assert found.boxes_px is not None
    assert found.boxes_px[:, 0].tolist() == [0.0, 8.0]


@pytest.mark.parametrize(
    "wrong", [np.zeros((1, 3, 3)), np.zeros((1, 2, 2)), np.zeros(6), "text", [PERSON, PERSON[:1]], 7, {"a": 1}]
)
def test_another_form_is_an_error_that_names_the_expected_one(wrong):
    with pytest.raises(DetectorError, match=r"It returned .* Expected x, y and confidence, shape \(person, 2, 3\)"):
        parse_detections(wrong, 2, "It")


def test_boxes_must_match_the_people():
    with pytest.raises(DetectorError, match="with 2 boxes"):
        parse_detections((PERSON, np.zeros((2, 4))), 2, "It")


def test_infinite_numbers_are_refused():
    with pytest.raises(DetectorError, match="infinite number"):
        parse_detections(PERSON * np.inf, 2, "It")
    with pytest.raises(DetectorError, match="infinite number"):
        FrameDetections(np.full((1, 2, 2), np.inf), np.zeros((1, 2)))


def test_the_shapes_of_a_record_must_match():
    with pytest.raises(DetectorError, match="keypoints_px of an image has the shape"):
        FrameDetections(np.zeros((1, 3, 2)), np.zeros((1, 2)))
