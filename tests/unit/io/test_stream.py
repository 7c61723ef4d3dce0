"""The stream protocol: lines survive a round trip, and no bytes raise an exception."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.io.stream import LineReader, RejectedLine, line_of
from posefuse.model.view_message import ViewMessage
from tests.properties import examples

CAMERAS = ("left", "right\n", "mitte ü")
READER = LineReader(CAMERAS, 3, 4)
GOOD = {"camera": "left", "time_s": 0.5, "people": [{"keypoints": [[1, 2, 0.5], [3.5, 4], None], "track_id": 7}]}


def refused(**changes: object) -> RejectedLine:
    actual = READER.read(json.dumps(GOOD | changes).encode())
    assert isinstance(actual, RejectedLine)
    return actual


def person(*keypoints: object, **more: object) -> list[dict[str, object]]:
    return [{"keypoints": list(keypoints), **more}]


def test_hand_written_line_is_read():
    observed = READER.read(json.dumps(GOOD | {"frame": 3, "comment": "more is allowed"}).encode())
    assert isinstance(observed, ViewMessage)
    assert (observed.view, observed.time_s, observed.track_ids.tolist()) == (0, 0.5, [7])
    nan = np.nan
    np.testing.assert_array_equal(observed.keypoints_px, [[[1, 2], [3.5, 4], [nan, nan]]])
    np.testing.assert_array_equal(observed.confidence, [[0.5, nan, nan]])


def test_line_without_people_is_read():
    observed = READER.read(b'{"camera": "left", "time_s": -3, "people": []}')
    assert isinstance(observed, ViewMessage)
    assert observed.keypoints_px.shape == (0, 3, 2)


def test_one_coordinate_alone_is_missing():
    observed = READER.read(
        json.dumps(GOOD | {"people": person([1, None, 0.9], [None, None, None], [1, 2, None])}).encode()
    )
    assert isinstance(observed, ViewMessage)
    assert np.isnan(observed.keypoints_px[0, :2]).all()
    assert np.isnan(observed.confidence[0]).all()


@pytest.mark.parametrize(
    ("changes", "fault", "words"),
    [
        ({"camera": "lft"}, "unknown camera", "Did you mean 'left'?"),
        ({"camera": 3}, "wrong shape", "Expected `str`, got `int` - at `$.camera`"),
        ({"time_s": "now"}, "wrong shape", "Expected `float`"),
        ({"time_s": 1.7e12}, "impossible number", "expected seconds"),
        ({"people": [{}]}, "wrong shape", "missing required field `keypoints`"),
        (
            {"people": person([1, 2], [3, 4])},
            "wrong keypoints",
            "people[0] has 2 keypoints; the skeleton of this stream has 3",
        ),
        ({"people": person([1], [3, 4], None)}, "wrong keypoints", "[x, y], [x, y, confidence] or null"),
        ({"people": person([], [3, 4], None)}, "wrong keypoints", "[x, y], [x, y, confidence] or null"),
        ({"people": person([1, 2, 3, 4], [3, 4], None)}, "wrong keypoints", "4 numbers"),
        ({"people": person([1e7, 2], None, None)}, "impossible number", "1e+06 px"),
        ({"people": person([1, 2, -0.5], None, None)}, "impossible number", "negative"),
        ({"people": person(None, None, None, track_id=-7)}, "impossible number", "track_id is -7"),
        ({"people": person(None, None, None) * 5}, "too many people", "at most 4"),
    ],
)
def test_rejected_line_states_the_fault_and_reason(changes, fault, words):
    actual = refused(**changes)
    assert actual.fault == fault
    assert words in actual.reason


@pytest.mark.parametrize(
    "line", [b"", b"null", b"[]", b"{", b"\xff\xfe", b"[" * 100_000, b'{"camera": NaN}', b"1e999", b"\x00"]
)
def test_arbitrary_bytes_are_rejected(line):
    assert isinstance(READER.read(line), RejectedLine)


def test_nan_is_rejected_with_a_hint():
    actual = READER.read(b'{"camera": "left", "time_s": NaN, "people": []}')
    assert isinstance(actual, RejectedLine)
    assert "null" in actual.reason


@given(st.integers(0, 2**32 - 1), st.integers(0, 4))
@examples(60)
def test_lines_survive_a_round_trip(seed, people):
    rng = np.random.default_rng(seed)
    pixels = rng.normal(size=(people, 3, 2)) * 10.0 ** rng.integers(-9, 5)
    confidence = rng.random((people, 3))
    confidence[rng.random((people, 3)) < 0.3] = np.nan
    gone = rng.random((people, 3)) < 0.3
    pixels[gone], confidence[gone] = np.nan, np.nan
    view = ViewMessage(int(rng.integers(3)), rng.normal() * 1e6, pixels, confidence, rng.integers(-1, 99, people))
    line = line_of(CAMERAS[view.view], view)
    assert line.count(b"\n") == 1
    observed = READER.read(line)
    assert isinstance(observed, ViewMessage)
    assert (observed.view, observed.time_s) == (view.view, view.time_s)
    for name in ("keypoints_px", "confidence", "track_ids"):
        np.testing.assert_array_equal(getattr(observed, name), getattr(view, name))
