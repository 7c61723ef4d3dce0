"""Output of the command line fits the window."""

from types import SimpleNamespace

import pytest

from posefuse.cli import console
from posefuse.cli.explain import _summary_of_names
from posefuse.skeleton.skeletons import shipped_skeleton


@pytest.mark.parametrize("folder", ["out", "a/" * 50])
def test_file_names_are_not_broken(folder, capsys):
    names = [f"person_{i}.csv" for i in range(1, 41)]
    console.wrote(names, folder, "That is all.")
    lines = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in lines if folder not in line or folder == "out")
    assert " ".join(lines) == f"Wrote {', '.join(names)} to {folder} That is all."


def test_files_of_several_people_are_one_word(capsys, monkeypatch):
    names = ["keypoints.csv", "a.trc", "a.mot", "b.trc", "b.mot", "report.html"]
    console.wrote(names, "out")
    assert capsys.readouterr().out == "Wrote keypoints.csv, 2x.trc, 2x.mot, report.html to out\n"
    monkeypatch.setattr(console.detail, "verbose", True)
    console.wrote(names, "out")
    assert "a.trc, a.mot" in capsys.readouterr().out


def test_many_notes_are_cut_except_with_verbose(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    texts = [f"Note {i} is a sentence of many words that does not fit on a line of eighty columns." for i in range(6)]
    console.notes(texts[:2])
    assert "..." not in capsys.readouterr().out
    console.notes(texts)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert lines[0].endswith("...")
    assert "and 4 more" in lines[-1]
    monkeypatch.setattr(console.detail, "verbose", True)
    console.notes(texts)
    assert capsys.readouterr().out.count("columns.") == 6


@pytest.mark.parametrize(("seconds", "text"), [(7.26, "7.3 s"), (119.6, "2 min 00 s"), (3720.0, "1 h 02 min")])
def test_durations(seconds, text):
    assert console.format_duration(seconds) == text


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
