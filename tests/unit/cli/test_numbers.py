"""Numbers on the command line."""

import pytest
from cyclopts import _convert

from posefuse.cli.numbers import refuse_fractions, whole_number


@pytest.mark.parametrize(("text", "number"), [("7", 7), ("-3", -3), ("30.0", 30)])
def test_integers_are_converted(text, number):
    assert whole_number(text) == number


@pytest.mark.parametrize("text", ["1.5", "1e1", "many", "", "nan."])
def test_other_numbers_and_words_are_refused(text):
    with pytest.raises(ValueError, match="integer|invalid literal|could not convert"):
        whole_number(text)


def test_the_parser_uses_the_conversion():
    refuse_fractions()
    assert _convert._converters[int] is whole_number
