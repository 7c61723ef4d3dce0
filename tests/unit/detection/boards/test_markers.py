"""Markers of any dictionary, also inverted or mirrored, are identified in few searches."""

import numpy as np
import pytest

from posefuse.detection.boards import markers
from posefuse.detection.boards.library import dictionary_of
from posefuse.detection.boards.markers import MARKER_FAMILIES, identify_markers
from posefuse.io.board_specs import read_board_spec
from tests.boards import picture

CELL_PX = 8


def sheet(name: str, numbers: range) -> np.ndarray:
    """An image of some markers in a row."""
    dictionary = dictionary_of(name)
    side = CELL_PX * (dictionary.markerSize + 2)
    drawn = [np.pad(dictionary.generateImageMarker(k, side), 2 * CELL_PX, constant_values=255) for k in numbers]
    return np.pad(np.hstack(drawn), 20, constant_values=255)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("name", MARKER_FAMILIES)
def test_every_dictionary_is_identified(name, inverted, mirrored):
    image = sheet(name, range(3, 9))
    image = 255 - image if inverted else image
    found = identify_markers([np.ascontiguousarray(image[:, ::-1]) if mirrored else image])
    assert found is not None
    family = name.removesuffix("1000")
    assert found.dictionary in (name, f"{family}50")
    assert (found.inverted, found.mirrored, found.n_markers, found.highest) == (inverted, mirrored, 6, 8)


def test_the_dictionary_has_all_markers():
    found = identify_markers([sheet("5X5_1000", range(95, 105))])
    assert found is not None
    assert (found.dictionary, found.n_markers, found.highest) == ("5X5_250", 10, 104)


def test_a_clear_board_is_identified_in_two_images(monkeypatch):
    searched = []
    whole = markers._numbers
    monkeypatch.setattr(markers, "_numbers", lambda *a, **k: (searched.append(a), whole(*a, **k))[1])
    empty = np.full((200, 300), 127, dtype=np.uint8)
    board = picture(read_board_spec("charuco:6x5,square=30mm"), px_per_m=1400.0)
    found = identify_markers([empty, board, board, *[board] * 20])
    assert found is not None
    assert found.images == (1, 2)
    assert len(searched) == 2 * 3 + 2
    searched.clear()
    assert identify_markers([empty] * 5) is None
    assert len(searched) == 2 * 5
