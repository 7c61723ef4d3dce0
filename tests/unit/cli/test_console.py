"""What the command line prints keeps to its window."""

import pytest

from posefuse.cli import console
from posefuse.cli.explain import _in_short
from posefuse.skeleton.skeletons import shipped_skeleton


@pytest.mark.parametrize("folder", ["out", "a/" * 50])
def test_names_of_files_are_never_broken(folder, capsys):
    names = [f"person_{i}.trc" for i in range(1, 41)]
    console.wrote(names, folder, "That is all.")
    lines = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in lines if folder not in line or folder == "out")
    assert " ".join(lines) == f"Wrote {', '.join(names)} to {folder} That is all."


def test_sentences_are_broken_and_paths_are_not(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    path = "/a/very/long/folder" * 6
    console.note(f"There is {path} and then there are many more words, so many that they do not fit on a single line.")
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if len(line) > 80] == [path]
    assert len(lines) > 2


def test_a_share_of_nothing_is_a_dash():
    assert console.percent(float("nan")) == "-"
    assert console.percent(0.123) == "12.3 %"


def test_many_keypoints_are_told_by_their_parts():
    skeleton = shipped_skeleton("coco_wholebody_133")
    assert _in_short(["nose", "left_eye"], skeleton) == "nose, left_eye"
    told = _in_short(list(skeleton.keypoints), skeleton)
    assert told.startswith("left hand (21 of 21), right hand (21 of 21), face (68 of 68), nose, left_eye")
    assert told.endswith("(23 in all)")
    hand = [skeleton.keypoints[k] for k in skeleton.parts[0].keypoints[:13]]
    assert _in_short(hand, skeleton) == "left hand (13 of 21)"
