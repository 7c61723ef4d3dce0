"""CSV files as columns."""

import numpy as np
import pyarrow.csv as arrow_csv
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posefuse.errors import FileError
from posefuse.io.columns import Words
from posefuse.io.csv_columns import header, read_csv, write_csv

NUMBERS = st.lists(st.floats(allow_infinity=True, allow_nan=True), min_size=1, max_size=20)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("csv") / "a.csv"


@settings(deadline=None)  # the first call imports
@given(values=NUMBERS)
def test_numbers_are_exact_and_read_alike_by_others(file, values):
    write_csv([{"x": np.array(values), "n": np.arange(len(values))}], file)
    for found in (
        read_csv(file, words=(), numbers=("x",))["x"],
        arrow_csv.read_csv(file)["x"].cast("float64", safe=False),
    ):
        np.testing.assert_array_equal(np.array(found, dtype=np.float64), values)


@given(words=st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\r\0"), min_size=1), max_size=9))
def test_words_with_quotes_commas_and_line_ends(file, words):
    write_csv([{"w": Words.of([*words, None])}], file)
    found = read_csv(file, words=("w",), numbers=())["w"]
    assert isinstance(found, Words)
    assert found.values().tolist()[: len(words)] == words


def test_text_of_a_table(file):
    table = {
        "a": np.array([1.0, np.nan]),
        "b": np.ma.masked_array([3, 4], [False, True]),
        "c, d": Words.of(['e"', None]),
    }
    write_csv([table, table], file, quoted_header=False)
    assert file.read_text() == 'a,b,"c, d"\n' + '1,3,"e"""\n,,\n' * 2
    assert header(file) == ["a", "b", "c, d"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n3\n", "row 2: expected 2 cells, got 1. Is the file truncated"),
        ("a,b\n1,2\n3,x\n", "row 2: the column b does not contain numbers: 'x'"),
        ("a,b\n1,1_0\n", "row 1: the column b does not contain numbers"),
        ("a,a\n1,2\n", "two columns with the same name"),
    ],
)
def test_broken_files_are_reported_with_the_row(file, text, words):
    file.write_text(text)
    with pytest.raises(FileError, match=words):
        read_csv(file, words=(), numbers=("a", "b"))
