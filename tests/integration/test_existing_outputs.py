"""No command replaces what exists unless it is told to, and a failed run leaves it as it was.

Every command of the parser is in one of two tables: those that write, and those that do not. A new one fails the test
until it is.
"""

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pytest

import posefuse
from posefuse.batch.work import run_job
from posefuse.cli.main import COMMANDS, app
from posefuse.cli.simulate import write_scene
from posefuse.errors import OutputExistsError
from posefuse.io.calibration.anipose import write as write_calibration
from posefuse.io.stream import lines_of
from posefuse.synthetic.options import CLEAN, SceneOptions
from tests.boards import SPEC, render, small_rig
from tests.conftest import ROOT

SHORT = ("--duration-s", "0.2", "--cameras", "3")
FAST = ("--solve", "frame", "--pairs", "labels", "--people", "one", "--end-s", 0.4)
RENAME = '[[edit]]\ndo = "rename"\nperson = "person_1"\nto = "Ada"\n'
KEPT = "the result of these inputs and options; nothing was done"
Arguments = tuple[object, ...]


@dataclass(frozen=True)
class Inputs:
    """Inputs of all commands: a recording with its truth, one with late views, a result, edits, videos of a board."""

    recording: Path
    result: Path
    edits: Path

    @property
    def late(self) -> Path:
        return self.edits.parent / "late"

    @property
    def board_videos(self) -> Path:
        return self.edits.parent / "videos"

    @property
    def lenses(self) -> Path:
        return self.edits.parent / "lenses" / "lenses.toml"

    @property
    def truth(self) -> Path:
        return self.recording / "truth.nc"


REFUSES: dict[str, Callable[[Inputs], Arguments]] = {
    "simulate": lambda _: (*SHORT, "-o", "out"),
    "simulate-people": lambda _: ("--people", 2, *SHORT, "-o", "out"),
    "convert": lambda given: (given.recording / "keypoints.nc", "-o", "out.csv"),
    "convert --to": lambda given: (given.recording / "keypoints.nc", "-o", "out", "--to", "openpose"),
    "convert -o": lambda given: (given.result, "-o", "out.trc"),
    "evaluate": lambda given: (given.result, given.truth),
    "compare": lambda given: (given.recording, "--methods", "simple,midpoint", "--no-timing", *FAST, "-o", "out"),
    "sync": lambda given: (given.late, "--keypoints", given.late / "keypoints.nc"),
    "calibrate-noise": lambda given: (given.recording, "--end-s", 0.4),
    "board": lambda _: ("-o", "out.pdf"),
    "people": lambda given: (given.result, "-o", "people.html"),
    "calibrate": lambda given: (
        given.board_videos,
        "--board",
        SPEC,
        "--intrinsics",
        given.lenses,
        "--jobs",
        1,
        "-o",
        "out.toml",
    ),
    "refine-calibration": lambda given: (given.recording, "--end-s", 0.3, "-o", "out.toml"),
    "edit": lambda given: (given.result, given.edits),
    "report": lambda given: (given.result, "-o", "out.html"),
    "view": lambda given: (given.result, "--save", "out.rrd"),
    "overlay": lambda given: (given.result, "--blank", "--end-s", 0.1, "-o", "out"),
    "opensim": lambda given: (given.result, "-o", "out"),
    "plot": lambda given: (given.result, "--figure", "errors", "-o", "out"),
    "init": lambda _: (),
}
"""Calls that refuse to run twice, by the command that is their first word."""
RESUMES: dict[str, Callable[[Inputs], Arguments]] = {
    "reconstruct": lambda given: (given.recording, *FAST, "-o", "out"),
    "batch": lambda given: (given.recording, *FAST, "-o", "out"),
    "demo": lambda _: (),
}
"""Commands that keep or replace their own result of the same inputs and options."""
WRITES_NOTHING: dict[str, Callable[[Inputs], Arguments]] = {
    "inspect": lambda given: (given.recording, "--deep"),
    "doctor": lambda given: (),
    "explain": lambda given: (given.result, "--frame", 3),
    "stream": lambda given: ("--calibration", given.recording / "calibration.toml", "--skeleton", "halpe_26"),
    "replay": lambda given: (given.recording,),
    "methods": lambda _: (),
    "formats": lambda _: (),
    "detector": lambda _: ("list",),
}
CHECKED_ELSEWHERE = {
    "detect": "unit/pipeline/test_detect.py",
    "run": "unit/pipeline/run/test_recipe.py",
    "warm-up": "unit/pipeline/test_warm_up.py",
}
"""Commands that need videos and resume, or take long, and the tests of what they do to an existing output."""


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Inputs:
    folder = tmp_path_factory.mktemp("inputs")
    given = Inputs(folder / "recording", folder / "result", folder / "edits.toml")
    given.recording.mkdir()
    write_scene(posefuse.simulate(SceneOptions(duration_s=2.0, cameras=4, detector=CLEAN)), given.recording)
    given.late.mkdir()
    late = SceneOptions(duration_s=4.0, cameras=4, detector=replace(CLEAN, max_offset_s=0.3))
    write_scene(posefuse.simulate(late), given.late)
    options = posefuse.Options(solve="frame", pairs="labels", end_s=0.4)
    posefuse.reconstruct_recording(given.recording, given.result, options)
    given.edits.write_text(RENAME)
    render(small_rig(), given.board_videos)
    given.lenses.parent.mkdir()
    write_calibration(small_rig(), given.lenses)
    return given


@pytest.fixture(autouse=True)
def _batches_in_this_process(monkeypatch):
    """Starting a process takes seconds."""
    monkeypatch.setattr("posefuse.cli.batch._run", lambda todo, *_: map(run_job, todo))


@pytest.fixture
def given(made, tmp_path, monkeypatch) -> Inputs:
    """The inputs in a folder of the test's own, which is the current one."""
    monkeypatch.chdir(tmp_path)
    for source in made.recording.parent.rglob("*"):
        if source.is_file():
            target = tmp_path / source.relative_to(made.recording.parent)
            target.parent.mkdir(exist_ok=True)
            target.write_bytes(source.read_bytes())
    return Inputs(tmp_path / "recording", tmp_path / "result", tmp_path / "edits.toml")


def files_in(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def said(done: tuple[int, str, str]) -> str:
    """Return what a command that succeeded printed, in one line."""
    assert done[0] == 0
    return " ".join(done[1].split())


def folders_in(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if path.is_dir()}


def has_overwrite(command: str) -> bool:
    return any("--overwrite" in argument.names for argument in app[command].assemble_argument_collection())


def test_every_command_is_covered():
    writing = {name.partition(" ")[0] for name in (*REFUSES, *RESUMES)}
    assert set(COMMANDS) == {*writing, *WRITES_NOTHING, *CHECKED_ELSEWHERE}
    assert {name for name in COMMANDS if has_overwrite(name)} - CHECKED_ELSEWHERE.keys() == writing
    assert all((ROOT / "tests" / test).is_file() for test in CHECKED_ELSEWHERE.values())


def fail_to_replace(monkeypatch) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)


@pytest.mark.parametrize("name", REFUSES)
def test_second_run_is_refused(name, run, given, tmp_path, monkeypatch):
    if name == "view":
        pytest.importorskip("rerun", reason="rerun is not installed (extra view)")
    if name == "opensim":
        pytest.importorskip("opensim", reason="OpenSim is not installed (extra opensim)")
    command = (name.partition(" ")[0], *REFUSES[name](given))
    assert run(*command)[0] == 0
    before, folders = files_in(tmp_path), folders_in(tmp_path)
    code, _, wrong = run(*command)
    assert code == 1
    assert "already" in wrong
    assert "give --overwrite to replace it, or choose another" in wrong
    assert wrong.replace("... ", "").strip().count(". ") == 0
    assert (files_in(tmp_path), folders_in(tmp_path)) == (before, folders)
    with monkeypatch.context() as patched:
        fail_to_replace(patched)
        assert run(*command, "--overwrite")[0] == 1
    assert (files_in(tmp_path), folders_in(tmp_path)) == (before, folders)
    assert run(*command, "--overwrite")[0] == 0
    assert files_in(tmp_path).keys() == before.keys()


@pytest.mark.parametrize("name", ["reconstruct", "batch"])
def test_same_inputs_and_options_resume_and_others_are_refused(name, run, given, tmp_path, monkeypatch):
    command = (name, *RESUMES[name](given))
    assert run(*command)[0] == 0
    before = files_in(tmp_path)
    code, output, _ = run(*command)
    assert code == 0
    if name == "reconstruct":
        assert " ".join(output.split()) == f"out already contains {KEPT}."
    assert files_in(tmp_path) == before
    others = (*command, "--triangulation.min-views", 2)
    code, output, wrong = run(*others)
    assert code == 1
    assert "of other inputs, options or versions; give --overwrite to replace it" in wrong + " ".join(output.split())
    overview = {"out/batch.csv", "out/batch.html"}
    after = files_in(tmp_path)
    assert {path: after[path] for path in after if path not in overview} == {
        path: before[path] for path in before if path not in overview
    }
    before = after
    with monkeypatch.context() as patched:
        fail_to_replace(patched)
        assert run(*others, "--overwrite")[0] == 1
    assert run(*others, "--overwrite")[0] == 0
    assert files_in(tmp_path).keys() == before.keys()
    assert files_in(tmp_path) != before
    (given.recording / "calibration.toml").write_text((given.recording / "calibration.toml").read_text() + "\n")
    assert run(*others)[0] == 1


def test_result_of_reconstruct_is_kept_by_batch_and_the_other_way_round(run, given, tmp_path):
    assert run("reconstruct", given.recording, *FAST, "-o", "out/recording")[0] == 0
    assert "0 done, 1 kept" in run("batch", given.recording, *FAST, "-o", "out")[1]
    assert run("batch", given.recording, *FAST, "-o", "other")[0] == 0
    assert KEPT in said(run("reconstruct", given.recording, *FAST, "-o", "other/recording"))


def test_further_formats_and_edits_are_part_of_the_request(run, given):
    command = ("reconstruct", given.recording, *FAST, "-o", "out")
    assert run(*command, "--also", "npz")[0] == 0
    assert KEPT in said(run(*command, "--also", "npz"))
    assert run(*command)[0] == 1
    assert run(*command, "--also", "npz", "--edits", given.edits)[0] == 1
    assert run(*command, "--edits", given.edits, "--overwrite")[0] == 0
    assert KEPT in said(run(*command, "--edits", given.edits))
    given.edits.write_text(RENAME.replace("Ada", "Eve"))
    assert run(*command, "--edits", given.edits)[0] == 1


def test_missing_files_of_a_result_are_written_again(run, given, tmp_path):
    command = ("reconstruct", given.recording, *FAST, "-o", "out")
    run(*command)
    before = files_in(tmp_path)
    for name in ("keypoints.csv", "reconstruction.nc"):
        (tmp_path / "out" / name).unlink()
        assert run(*command)[0] == 0
        assert files_in(tmp_path) == before
    (tmp_path / "out" / "reconstruction.nc").write_bytes(b"something else")
    assert run(*command)[0] == 1
    assert (tmp_path / "out" / "reconstruction.nc").read_bytes() == b"something else"


def test_folders_of_other_files_are_never_written_to(run, given, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.csv").write_text("precious")
    before = files_in(tmp_path)
    for command in (("simulate", *SHORT), ("reconstruct", given.recording, *FAST), ("edit", given.result, given.edits)):
        for flags in ((), ("--overwrite",)):
            code, _, wrong = run(*command, "-o", "out", *flags)
            assert (code, "already contains other files (thesis.csv)" in wrong) == (1, True)
            assert files_in(tmp_path) == before


def test_demo_replaces_its_own_result_only(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("posefuse.synthetic.options.SceneOptions", partial(SceneOptions, duration_s=0.5))
    assert run("demo")[0] == 0
    before = files_in(tmp_path)
    assert run("demo")[0] == 0
    assert files_in(tmp_path) == before
    (tmp_path / "demo" / "demo.txt").unlink()
    before = files_in(tmp_path)
    code, _, wrong = run("demo")
    assert (code, "demo already contains recording, result; give --overwrite" in wrong) == (1, True)
    assert files_in(tmp_path) == before
    assert run("demo", "--overwrite")[0] == 0


def test_batch_of_other_recordings_does_not_replace_the_overview(run, given, tmp_path):
    (tmp_path / "other").mkdir()
    for file in given.recording.iterdir():
        (tmp_path / "other" / file.name).write_bytes(file.read_bytes())
    command = ("batch", *FAST, "-o", "out")
    assert run(*command[:1], given.recording, *command[1:])[0] == 0
    before = files_in(tmp_path)
    code, _, wrong = run(*command[:1], tmp_path / "other", *command[1:])
    assert (code, "lists recordings that are not in this batch (recording)" in wrong) == (1, True)
    assert files_in(tmp_path) == before
    assert "1 done, 1 kept" in run(*command[:1], tmp_path / "other", given.recording, *command[1:])[1]
    (tmp_path / "out" / "batch.csv").write_text("name,grade\n")
    assert run(*command[:1], given.recording, *command[1:])[0] == 1
    assert (tmp_path / "out" / "batch.csv").read_text() == "name,grade\n"


@pytest.mark.parametrize("name", WRITES_NOTHING)
def test_other_commands_write_nothing(name, run, given, tmp_path, monkeypatch):
    if name == "stream":
        rig = posefuse.read_cameras(given.recording / "calibration.toml")
        lines = [line for _, line in lines_of(posefuse.read_detections(given.recording / "keypoints.nc"), rig.names)]
        (tmp_path / "lines.jsonl").write_bytes(b"".join(lines[:40]))
    before, folders = files_in(tmp_path), folders_in(tmp_path)
    with (tmp_path / "lines.jsonl" if name == "stream" else Path(os.devnull)).open() as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        assert run(name, *WRITES_NOTHING[name](given))[0] == 0
    assert (files_in(tmp_path), folders_in(tmp_path)) == (before, folders)


def test_python_names_the_argument(made, tmp_path):
    result = posefuse.read_reconstruction(made.result / "reconstruction.nc")
    posefuse.write(result, tmp_path / "a.trc")
    with pytest.raises(
        OutputExistsError, match=r"a\.trc already exists; give `overwrite=True` to replace it, or choose"
    ):
        posefuse.write(result, tmp_path / "a.trc")
    posefuse.write(result, tmp_path / "a.trc", overwrite=True)
    posefuse.reconstruct_recording(made.recording, tmp_path / "out", posefuse.Options(solve="frame"))
    assert posefuse.reconstruct_recording(made.recording, tmp_path / "out", posefuse.Options(solve="frame")).kept
    with pytest.raises(OutputExistsError, match="overwrite=True"):
        posefuse.reconstruct_recording(made.recording, tmp_path / "out", posefuse.Options(pairs="labels"))
