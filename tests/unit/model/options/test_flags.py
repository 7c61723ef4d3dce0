"""Messages name arguments in Python, flags on the command line."""

import ast
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest

from posefuse.cli.main import COMMANDS as PROGRAMS
from posefuse.cli.main import main
from posefuse.model.options.calibration import CalibrateOptions, PeopleOptions
from posefuse.model.options.catalog import options_by_name
from posefuse.model.options.flags import COMMANDS, FLAGS, as_flags, options_as_flags
from posefuse.model.options.refinement import RefineOptions
from posefuse.model.options.stream import StreamOptions
from posefuse.visualize.overlay.options import OverlayOptions
from tests.conftest import ROOT

SOURCES = [path for path in sorted((ROOT / "src" / "posefuse").rglob("*.py")) if "cli" not in path.parts]

OTHER_TEXT = {
    "detection/environments.py": "flags of pip and uv",
    "detection/interpreters.py": "flags of uv",
    "model/options/flags.py": "writes the flags",
    "report/contact_sheet.py": "the flag to copy from the page",
    "report/people.py": "a CSS variable",
    "report/command.py": "the command to copy from the page",
    "report/verdict.py": "a command in the page",
    "report/calibration/tables.py": "a CSS variable",
    "io/recording.py": "the command to calibrate a board with",
    "io/videos/writer.py": "a flag of pip",
    "io/options_template.py": "a file",
    "io/project.py": "a file",
}
"""Files whose texts contain flags that are not arguments of posefuse, or that only the command line writes."""

OTHER_ARGUMENTS = {
    "accept_findings", "also", "angle", "board", "calibration", "detect.crop", "detector",
    "detector_python", "device", "figure",
    "format", "images", "input", "intrinsics", "jobs", "keypoints", "max_time_shift_s", "output",
    "overwrite", "path", "python",
    "recording", "reference", "save", "scene_points", "scheduler", "sync", "timestamps", "video", "videos",
    "weights", "workers",
}  # fmt: skip
"""Arguments of functions and commands that are no options, and that messages may name."""


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Add `rate_hz`, such as `rate_hz=60`.", "Add --rate-hz, such as --rate-hz 60."),
        ("`pick='largest'` or `pick='track-id'`", "--pick largest or --pick track-id"),
        ("`exclude_camera=['cam 1', 'b']`", "--exclude-camera 'cam 1' b"),
        ("`tracker.smoother='lag'`", "--tracker.smoother lag"),
        ("`up='-y'`", "--up -y"),
        ("use `rescale=True`.", "use --rescale."),
        ("`videos={'cam_0': 'FILE'}`", "--video cam_0=FILE"),
        ("`image_size=(width, height)`", "--image-size width height"),
        ("`keypoints='/data/a b.npy'`  (arrays)", "--keypoints '/data/a b.npy'  (arrays)"),
        ("a board (`rigid=True`)", "a board (--from board)"),
        ("`posefuse.measure_sync` does", "posefuse sync does"),
        ("nothing to 'replace' in ``code``", "nothing to 'replace' in ``code``"),
    ],
)
def test_arguments_become_flags(text, expected):
    assert as_flags(text) == expected


def texts(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of every string of a file that is not a docstring."""
    tree = ast.parse(path.read_text("utf-8"))
    bare = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    inside = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts = [part.value if isinstance(part, ast.Constant) else "{}" for part in node.values]
            yield node.lineno, "".join(str(part) for part in parts)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and not {id(node)} & (bare | inside):
            yield node.lineno, node.value


def test_no_message_outside_the_command_line_names_a_flag():
    named = [
        f"{path.relative_to(ROOT)}:{line}: {text}"
        for path in SOURCES
        if str(path.relative_to(ROOT / "src" / "posefuse")) not in OTHER_TEXT
        for line, text in texts(path)
        if re.search(r"(?<![\w-])--[a-z]", text)
    ]
    assert named == []


def test_arguments_that_messages_name_exist():
    known = OTHER_ARGUMENTS | set(options_by_name()) | set(COMMANDS)
    known |= {entry.table for entry in options_by_name().values()}
    known |= {
        field.name
        for record in (CalibrateOptions, OverlayOptions, PeopleOptions, RefineOptions, StreamOptions)
        for field in fields(record)
    }
    quoted = {
        name for path in SOURCES for _, text in texts(path) for name in re.findall(r"`([a-z][\w.]*)(?:=|`)", text)
    }
    assert len(quoted) > 30
    assert quoted - known == set()
    assert {command.split()[1] for command in COMMANDS.values()} <= set(PROGRAMS)
    assert {name.partition("=")[0] for name in FLAGS} <= known


def test_one_error_in_python_and_on_the_command_line(tmp_path, capsys):
    from posefuse import PosefuseError, reconstruct_recording

    with pytest.raises(PosefuseError, match=r"Set `calibration` to its path\.") as caught:
        reconstruct_recording(tmp_path, tmp_path / "out")
    assert "--" not in str(caught.value)
    with pytest.raises(SystemExit):
        main(["reconstruct", str(tmp_path), "--output", str(tmp_path / "out")])
    assert "Set --calibration to its path." in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("stature_m must be a number.", "--stature-m must be a number."),
        ("rate_hz must be 3. skeleton must be a name.", "--rate-hz must be 3. --skeleton must be a name."),
        ("triangulation.min_views must be 2.", "--triangulation.min-views must be 2."),
        ("lab.toml: tracker.lag_s must be at least 0 s.", "lab.toml: tracker.lag_s must be at least 0 s."),
        ("end_s (1.0) must be above start_s (2.0).", "--end-s (1.0) must be above --start-s (2.0)."),
        (
            "got 'left_knee' in a_file.toml, `rate_hz` and rate_hz=3",
            "got 'left_knee' in a_file.toml, `rate_hz` and rate_hz=3",
        ),
        ("The skeleton must have rate_hz_of.", "The skeleton must have rate_hz_of."),
    ],
)
def test_names_of_options_are_shown_as_flags(message, shown):
    assert options_as_flags(message) == shown


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("Set `rate_hz`.", "Set --rate-hz."),
        ("camera '`rate_hz`' is silent", "camera '`rate_hz`' is silent"),
        ('camera "it\'s `x`" is silent; set `rate_hz`', 'camera "it\'s `x`" is silent; set --rate-hz'),
        ("the views' `rate_hz` and the cameras' `rate_hz`", "the views' --rate-hz and the cameras' --rate-hz"),
    ],
)
def test_names_in_quotes_are_not_arguments(message, shown):
    assert as_flags(message) == shown


def test_an_invalid_value_names_its_flag(capsys):
    with pytest.raises(SystemExit):
        main(["calibrate", "folder", "-o", "c.toml", "--stature-m", "178"])
    text = " ".join(capsys.readouterr().err.split())
    assert "--stature-m must be a finite number above 0 and at most 100 m, got 178.0. Lengths are in meters" in text
