"""Tables of left/right methods and pair solvers, and their options."""

import pytest

from posefuse.errors import OptionsError
from posefuse.left_right import registry
from posefuse.left_right.pairs.registry import SOLVERS
from posefuse.model.options.left_right import SIDE_METHODS, SideOptions
from posefuse.model.options.pairs import PAIR_METHODS


def test_tables_agree_with_the_options():
    assert list(registry.METHODS) == list(SIDE_METHODS)
    assert [*SOLVERS, "labels"] == list(PAIR_METHODS)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"facing": "north"}, "must be \\+x, -x"),
        ({"facing": "0,0,0"}, "three numbers"),
        ({"swap_share": 0.5}, "between 0 and 0.5, exclusive, got 0.5"),
        ({"swap_duration_s": 0.0}, "swap_duration_s must be a finite number above 0"),
        ({"iterations": 0}, "iterations must be an integer from 1 to 1000"),
    ],
)
def test_invalid_options_are_errors(options, words):
    with pytest.raises(OptionsError, match=words):
        SideOptions(**options)
