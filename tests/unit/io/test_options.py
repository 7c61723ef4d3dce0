"""Options as TOML: the template is every option, and a wrong key is an error with a suggestion."""

import re
import tomllib
from dataclasses import fields, is_dataclass

import pytest

from posefuse.errors import FileError, OptionsError
from posefuse.io.options import options_from_dict, options_template, options_to_toml, read_options
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions


def test_the_template_is_the_defaults(tmp_path):
    path = tmp_path / "posefuse.toml"
    path.write_text(options_template())
    assert read_options(path) == Options()


def test_the_template_names_and_explains_every_option():
    lines = options_template().splitlines()

    def check(record, lines):
        for field in fields(record):
            if is_dataclass(getattr(record, field.name)):
                start = next(i for i, line in enumerate(lines) if line.strip("[]").split(".")[-1] == field.name)
                check(getattr(record, field.name), lines[start:])
                continue
            place = next(i for i, line in enumerate(lines) if line.removeprefix("# ").startswith(f"{field.name} = "))
            assert lines[place - 1].startswith("# ")
            assert len(lines[place - 1]) > 10

    check(Options(), lines)


def test_examples_in_the_template_are_valid():
    text = options_template()
    uncommented = re.sub(r"(?m)^# (\w+ = )", r"\1", text)
    data = tomllib.loads(uncommented)
    data.pop("exclude_camera")
    data.pop("start_s")
    data["align"].pop("height_m")
    options_from_dict(data, "template")


def test_options_survive(tmp_path):
    options = Options(cameras=("a", "b"), start_s=1.5, triangulation=TriangulationOptions(min_views=4))
    (tmp_path / "o.toml").write_text(options_to_toml(options))
    assert read_options(tmp_path / "o.toml") == options


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("camera = ['a']", r"o\.toml: unknown option 'camera'\. Did you mean 'cameras'"),
        ("[triangulation]\nmin_vews = 3", r"unknown option triangulation\.'min_vews'\. Did you mean 'min_views'"),
        ("triangulation = 3", "triangulation is a table of options, got 3"),
        ("[triangulation]\nmin_views = 'three'", r"triangulation\.min_views: cannot be 'three'"),
        ("rate_hz = true", "rate_hz: cannot be True"),
        ("pick = 'biggest'", r"pick: cannot be 'biggest'\. Choose one of: largest, track-id"),
        ("rate_hz = -1", "rate_hz must be a finite number above 0 Hz"),
        ("cameras = 'a'", "cameras: cannot be 'a'"),
    ],
)
def test_wrong_options_say_what_and_where(text, words, tmp_path):
    (tmp_path / "o.toml").write_text(text)
    with pytest.raises(OptionsError, match=words):
        read_options(tmp_path / "o.toml")


def test_a_file_that_is_none(tmp_path):
    with pytest.raises(FileError, match="No options file at"):
        read_options(tmp_path / "o.toml")
    (tmp_path / "o.toml").write_text("[a")
    with pytest.raises(FileError, match="is not TOML"):
        read_options(tmp_path / "o.toml")
