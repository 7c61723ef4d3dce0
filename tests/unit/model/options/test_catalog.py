"""Catalog of all options."""

import pytest

from posefuse.model.options.catalog import list_options


@pytest.mark.parametrize("entry", list(list_options()), ids=lambda entry: entry.name)
def test_every_option_has_a_help_sentence(entry):
    assert entry.text[0].isupper()
    assert entry.text.endswith(".")
