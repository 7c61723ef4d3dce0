"""Output of the command line fits the window."""

from types import SimpleNamespace

import pytest

from posefuse.cli import console
from posefuse.cli.explain import _summary_of_names
from posefuse.skeleton.skeletons import shipped_skeleton


@pytest.mark.parametrize("folder", ["out", "a/" * 50])
def test_file_names_are_not_broken(folder, capsys):
    names = [f"person_{i}.trc" for i in range(1, 41)]
    console.wrote(names, folder, "That is all.")
    lines = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in lines if folder not in line or folder == "out")
    assert " ".join(lines) == f"Wrote {', '.join(names)} to {folder} That is all."


def test_sentences_are_wrapped_and_paths_are_not(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    path = "/a/very/long/folder" * 6
    console.note(f"There is {path} and then there are many more words, more than fit on a single line.")
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if len(line) > 80] == [path]
    assert len(lines) > 2


def test_continued_lines_of_labeled_messages_are_indented(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    console.note("  note: " + "word " * 40)
    console.note("word " * 40)
    lines = capsys.readouterr().out.splitlines()
    assert [len(line) - len(line.lstrip()) for line in lines] == [2, 4, 4, 0, 0, 0]
    assert all(len(line) <= 80 for line in lines)


def test_percent_of_nan_is_a_dash():
    assert console.percent(float("nan")) == "-"
    assert console.percent(0.123) == "12.3 %"


def test_many_keypoints_are_summarized_by_part():
    skeleton = shipped_skeleton("coco_wholebody_133")
    assert _summary_of_names(["nose", "left_eye"], skeleton) == "nose, left_eye"
    results = _summary_of_names(list(skeleton.keypoints), skeleton)
    assert results.startswith("left hand (21 of 21), right hand (21 of 21), face (68 of 68), nose, left_eye")
    assert results.endswith("(23 in all)")
    hand = [skeleton.keypoints[k] for k in skeleton.parts[0].keypoints[:13]]
    assert _summary_of_names(hand, skeleton) == "left hand (13 of 21)"


def test_lines_after_a_label_begin_below_the_sentence(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    console.labeled("views", "word " * 40)
    console.labeled("reconstruct", "")
    *lines, last = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("views       word")
    assert len(lines) == 4
    assert all(line.startswith(" " * 12 + "word") and len(line) <= 80 for line in lines[1:])
    assert last.strip() == "reconstruct"


@pytest.mark.parametrize(("stage", "shown"), [("detecting", "5.0 images/s"), ("copying videos", "")])
def test_speed_is_shown_for_the_stage_that_counts_the_unit(stage, shown):
    column = console._SpeedColumn("images", "detecting")
    task = SimpleNamespace(speed=5.0, description=stage)
    assert str(column.render(task)) == shown  # type: ignore[arg-type]
