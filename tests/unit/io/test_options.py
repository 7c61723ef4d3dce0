"""Options as TOML: templates, project files, former names, and messages about invalid files."""

import re
import tomllib
from functools import reduce

import pytest

from posefuse.errors import FileError, OptionsError
from posefuse.io.options import (
    PROJECT_KEYS,
    options_from_dict,
    options_to_toml,
    read_options,
    read_project,
    stored_options,
)
from posefuse.io.options_template import options_template, project_template
from posefuse.model.options.catalog import list_options
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions


def test_template_holds_the_defaults(tmp_path):
    path = tmp_path / "posefuse.toml"
    path.write_text(options_template())
    assert read_options(path) == Options()


@pytest.mark.parametrize("entry", list(list_options()), ids=lambda entry: entry.name)
def test_template_explains_every_option(entry):
    table = options_template().split(f"[{entry.table}]\n")[-1] if entry.table else options_template()
    line = re.search(rf"(?m)^(# )?{entry.key} = ", table)
    assert line
    comment = table[: line.start()].rsplit("\n\n", 1)[-1].replace("\n# ", " ")
    assert f"Valid: {entry.expected}." in comment
    assert entry.text in comment


EXCLUSIVE = [("align", "height_m"), ("align", "floor"), ("align", "origin"), ("align", "forward")]
"""Examples that another example of the template excludes."""
NEED_OTHERS = {
    "noise.cameras", "noise.scale_px", "sync.cameras", "sync.start_s", "sync.offset_s", "sync.drift_ppm",
    "align.length_m", "align.length_between",
}  # fmt: skip
"""Examples of options that are valid only together with others, which the template sets."""


@pytest.mark.parametrize("template", [options_template(), project_template()], ids=["all", "common"])
def test_examples_in_the_templates_are_valid(template):
    data = tomllib.loads(re.sub(r"(?m)^# (\w+ = )", r"\1", template))
    for key in PROJECT_KEYS:
        data.pop(key, None)
    for table, key in EXCLUSIVE:
        data.get(table, {}).pop(key, None)
    options_from_dict(data, "template")


def test_each_example_in_the_template_is_valid_by_itself():
    data = tomllib.loads(re.sub(r"(?m)^# (\w+ = )", r"\1", options_template()))
    for entry in list_options():
        table = reduce(lambda tables, key: tables[key], entry.name.split(".")[:-1], data)
        if not entry.is_unset or entry.name in NEED_OTHERS:
            continue
        value: object = {entry.key: table[entry.key]}
        for key in reversed(entry.name.split(".")[:-1]):
            value = {key: value}
        options = options_from_dict(value, "template")
        assert options != Options(), entry.name


def test_project_template_has_paths_and_25_options(tmp_path):
    path = tmp_path / "posefuse.toml"
    path.write_text(project_template())
    options, paths = read_project(path)
    assert options == Options()
    assert (paths.recording, paths.output, paths.calibration) == (tmp_path / ".", tmp_path / "out", None)
    assert 20 <= sum(entry.bounds.common for entry in list_options()) <= 30
    assert len(project_template().splitlines()) < 150


def test_paths_are_relative_to_the_file(tmp_path):
    (tmp_path / "p.toml").write_text("recording = 'trial'\nkeypoints = '/data/pose'\npeople = 'one'\n")
    options, paths = read_project(tmp_path / "p.toml")
    assert (paths.recording, str(paths.keypoints)) == (tmp_path / "trial", "/data/pose")
    assert options.people == "one"
    assert read_options(tmp_path / "p.toml") == options
    (tmp_path / "p.toml").write_text("recording = 3\n")
    with pytest.raises(OptionsError, match=r"p\.toml: recording must be a path, got 3"):
        read_options(tmp_path / "p.toml")


def test_options_survive_a_round_trip(tmp_path):
    options = Options(cameras=("a", "b"), start_s=1.5, triangulation=TriangulationOptions(min_views=4))
    (tmp_path / "o.toml").write_text(options_to_toml(options))
    assert read_options(tmp_path / "o.toml") == options


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("camera = ['a']", r"o\.toml: unknown option 'camera'\. Did you mean 'cameras'"),
        (
            "[triangulation]\nmin_vews = 3",
            r"unknown option 'triangulation\.min_vews'\. Did you mean 'triang\w+\.min_views'",
        ),
        ("triangulation = 3", "triangulation must be a table of options, got 3"),
        (
            "[triangulation]\nmin_views = 'three'",
            r"triangulation\.min_views must be an integer of at least 2, got 'three'",
        ),
        ("rate_hz = true", "rate_hz must be a finite number above 0 Hz, got True"),
        ("pick = 'biggest'", r"pick must be one of largest, track-id, got 'biggest'\."),
        ("rate_hz = -1", "rate_hz must be a finite number above 0 Hz, got -1"),
        ("cameras = 'a'", "cameras must be a list of strings, got 'a'"),
        ("recordings = 'a'", "Did you mean 'recording'"),
        ("fps = 60", "Did you mean 'rate_hz'"),
        ("[triangulation]\nlikelihood_threshold = 0.3", r"Did you mean 'triangulation\.min_confidence'"),
        ("[trajectory]\ncalm = 0.3", r"Did you mean 'trajectory\.density_prior_s'"),
        ("min_views = 3", r"Did you mean 'triangulation\.min_views'"),
        ("zzz = 3", "Choose one of: people"),
    ],
)
def test_invalid_options_say_what_and_where(text, message, tmp_path):
    (tmp_path / "o.toml").write_text(text)
    with pytest.raises(OptionsError, match=message):
        read_options(tmp_path / "o.toml")


def test_all_problems_of_a_file_are_reported_together(tmp_path):
    (tmp_path / "o.toml").write_text(
        "fps = 60\nrate_hz = -1\n[tracker]\nmax_people = 0\n[triangulation]\nmethod = 'x'\n"
    )
    with pytest.raises(OptionsError) as caught:
        read_options(tmp_path / "o.toml")
    for name in ("'fps'", "rate_hz must", "tracker.max_people must", "triangulation.method must"):
        assert name in str(caught.value)


def test_stored_options_may_use_former_names():
    stored = {
        "sync": {"cameras": ["a"], "since_s": [0.0], "late_s": [0.1], "drift_ppm": [0.0]},
        "trajectory": {"rounds": 3},
    }
    options = stored_options(stored, "result")
    assert (options.sync.offset_s, options.trajectory.iterations) == ((0.1,), 3)


def test_missing_or_invalid_file(tmp_path):
    with pytest.raises(FileError, match="No options file at"):
        read_options(tmp_path / "o.toml")
    (tmp_path / "o.toml").write_text("[a")
    with pytest.raises(FileError, match="is not valid TOML"):
        read_options(tmp_path / "o.toml")
