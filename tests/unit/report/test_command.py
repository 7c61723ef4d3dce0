"""The command in a report makes the same result again."""

import re
import tomllib
from dataclasses import replace

import pytest

from posefuse.io.options import options_from_dict
from posefuse.model.options.options import Options
from posefuse.model.options.sync import SyncOptions
from posefuse.report.command import repeating_command


@pytest.mark.parametrize(
    "options",
    [
        Options(rate_hz=60.0, people="one", health="off"),
        Options(sync=SyncOptions(("cam 'a'", "b"), (0.0, 0.0), (0.25, 0.0), (0.0, 0.0))),
        replace(Options(), tracker=replace(Options().tracker, max_people=3)),
    ],
)
def test_options_in_the_command_are_those_of_the_result(options):
    text = repeating_command(options)
    found = re.fullmatch(r"cat > options.toml <<'END'\n(.*)END\n(posefuse reconstruct .*)", text, re.DOTALL)
    assert found
    assert options_from_dict(tomllib.loads(found[1]), "options.toml") == options
    assert "--options options.toml" in found[2]


def test_defaults_need_no_options():
    assert repeating_command(Options()) == "posefuse reconstruct RECORDING --output OUTPUT"


def test_own_skeletons_are_named_by_file():
    assert 'skeleton = "mouse_15.toml"' in repeating_command(Options(skeleton="mouse_15"))
    assert 'skeleton = "halpe_26"' in repeating_command(Options(skeleton="halpe_26"))
