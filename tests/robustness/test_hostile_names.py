"""Names from input files neither change output paths nor run as code in reports."""

from collections import Counter
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import posefuse
from posefuse.batch.work import run_job
from posefuse.errors import FileError, PosefuseError
from posefuse.io.files import checked_file_name
from posefuse.io.keypoints import detection_tables, native, openpose, replay, tidy
from posefuse.io.results.names import safe_names
from posefuse.io.results.registry import RESULTS
from posefuse.io.results.write import write_folder
from posefuse.model.batch import Job, JobResult
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Provenance, Reconstruction
from posefuse.model.track_events import Event
from posefuse.report.batch import batch_page
from posefuse.report.html import render_report
from posefuse.skeleton.skeletons import Skeleton
from tests.figures import posed
from tests.people import simulate_walkers, track_perfectly
from tests.properties import examples

PATHS = (
    "../../x", "/etc/x", "..", ".", "", "a/b", "C:\\x", "\\\\host\\x", "CON", "nul.txt", "com1 .csv", "x" * 300,
    "\N{GREEK SMALL LETTER ALPHA}" * 200, "a\nb", "a\0b", "x.", " ", "~", "*", "|x",
)  # fmt: skip
RUNS = (
    "<script>alert(1)</script>", '"><img src=x onerror=alert(1)>', "' onload='alert(1)", "</script><svg/onload=x>",
    "<!--", "]]>", "{{x}}", "${x}", "`x`", "\\u003cscript>", "&lt;b&gt;", "javascript:alert(1)", "a\n<b>\nc",
    "\N{RIGHT-TO-LEFT OVERRIDE}x", "</style><b>", "</title><b>", "<" * 2000,
)  # fmt: skip
evil = st.one_of(
    st.sampled_from(RUNS), st.text(st.sampled_from("<>\"'&/=` \nabcscript:\\${}!-"), min_size=1, max_size=40)
)


def renamed(result: Reconstruction, people: list[str], cameras: list[str]) -> Reconstruction:
    """Return the same result with other names of people and cameras."""
    rig = replace(
        result.rig, cameras=tuple(replace(c, name=n) for c, n in zip(result.rig.cameras, cameras, strict=True))
    )
    events = tuple(replace(e, person=people[0]) for e in result.events)
    tracks = None if result.tracks is None else replace(result.tracks, person_ids=tuple(people))
    return replace(result, person_ids=tuple(people), rig=rig, tracks=tracks, events=events)


def distinct(names: list[str], number: int) -> list[str]:
    """Return a number of different names."""
    actual = list(dict.fromkeys(names))[:number]
    return [*actual, *(f"other {i}" for i in range(number - len(actual)))]


def all_in(folder: Path) -> None:
    """The folder is all that is in the one above it, and nothing in it leads out."""
    assert [entry.name for entry in folder.parent.iterdir()] == [folder.name]
    for entry in folder.rglob("*"):
        assert not entry.is_symlink()
        assert len(entry.name.encode()) <= 255
        assert not set(entry.name) & set('\\:*?"<>|\n')


@pytest.mark.parametrize("form", [form.name for form in RESULTS if form.writes])
def test_result_writers_stay_in_their_folder(form, tmp_path):
    result, suits = posed("body_20", 2, 5), RESULTS.find(form).additional_name or f"p.{form}"
    for i in range(0, len(PATHS), 5):
        people = distinct(list(PATHS[i:]), 5)
        given_ = renamed(result, people, distinct(list(PATHS[::-1][i:]), len(result.rig)))
        folder = tmp_path / f"above_{i}" / "result"
        folder.mkdir(parents=True)
        try:
            posefuse.write(given_, folder / suits, form)
        except PosefuseError:
            assert list(folder.iterdir()) == []
        all_in(folder)


def test_default_outputs_stay_in_their_folder(tmp_path):
    result = track_perfectly(simulate_walkers(people=4, seconds=0.4))
    for i in (0, 8, 16):
        folder = tmp_path / f"above_{i}" / "result"
        folder.mkdir(parents=True)
        files, *_ = write_folder(renamed(result, distinct(list(PATHS[i:]), 4), list(result.rig.names)), folder)
        all_in(folder)
        assert {entry.name for entry in folder.iterdir()} == set(files)


@pytest.mark.parametrize("writer", [detection_tables, native, openpose, replay, tidy])
@pytest.mark.parametrize("name", PATHS)
def test_keypoint_writers_stay_in_their_folder(writer, name, tmp_path):
    scene = simulate_walkers(people=1, seconds=0.1).detections.views(["cam_0"])
    hostile = object.__new__(Detections)
    for field in scene.__dataclass_fields__:
        object.__setattr__(hostile, field, (name,) if field == "view_names" else getattr(scene, field))
    folder = tmp_path / "above" / "out"
    folder.mkdir(parents=True)
    suffix = {native: "k.nc", replay: "k.jsonl", tidy: "k.csv"}.get(writer, "k")
    try:
        writer.write(hostile, folder / suffix)
    except PosefuseError:
        assert list(folder.iterdir()) == []
    all_in(folder)


@pytest.mark.parametrize("name", [name for name in PATHS if name != "~"])
def test_invalid_file_names_are_refused(name):
    with pytest.raises(FileError, match="is not a valid file name"):
        checked_file_name(name)


@given(st.lists(st.text(min_size=0, max_size=300), min_size=1, max_size=6))
@examples(60)
def test_safe_names_are_valid_file_names(names):
    actual = safe_names(names)
    assert len({name.casefold() for name in actual}) == len(names)
    assert [checked_file_name(name) for name in actual] == list(actual)


class Shape(HTMLParser):
    """Structure of a page without its texts: elements, names of attributes, comments and declarations."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: Counter[tuple] = Counter()
        self.addresses: set[str] = set()
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found[(tag, *sorted(name for name, _ in attrs))] += 1
        self.addresses |= {(value or "").partition(":")[0] for name, value in attrs if name in ("href", "src")}

    def handle_comment(self, data: str) -> None:
        self.found[("comment", data)] += 1

    def handle_decl(self, decl: str) -> None:
        self.found[("declaration", decl)] += 1

    def unknown_decl(self, data: str) -> None:
        self.found[("declaration", data)] += 1


@cache
def report_of() -> Reconstruction:
    result = replace(track_perfectly(simulate_walkers(people=2, seconds=0.6)), swaps=None, poses=None)
    return replace(result, provenance=Provenance({"posefuse": "1"}, {"a": "0" * 64}, ("Health: a finding.", "a note")))


@given(st.lists(evil, min_size=8, max_size=8, unique=True))
@examples(4)
def test_names_do_not_change_the_structure_of_a_report(names):
    results = report_of()

    def page(words: list[str]) -> Shape:
        result = renamed(results, words[:2], distinct(words[2:4], len(results.rig)))
        names = (*words[5:7], *result.skeleton.keypoints[2:])
        skeleton = Skeleton(words[4], names, ((names[0], names[1]),), description=words[7])
        # Messages quote names; backticks outside of quotes mark arguments.
        said = repr(words[7])
        notes = ("Health: " + said, said)
        provenance = Provenance({"posefuse": words[7]}, {words[6]: "0" * 64}, notes)
        events = (Event(3, 0.12, words[0], "lost", said), Event(4, 0.16, words[2], "camera_silent", said))
        return Shape(render_report(replace(result, skeleton=skeleton, provenance=provenance, events=events)))

    plain, hostile = page([f"name {i}" for i in range(8)]), page(names)
    assert hostile.found == plain.found
    assert hostile.addresses == plain.addresses


@given(st.lists(evil, min_size=3, max_size=3, unique=True))
@examples(30)
def test_names_do_not_change_the_structure_of_a_batch_report(names):
    def page(words: list[str]) -> Shape:
        jobs = [JobResult(words[0], "failed", repr(words[1])), JobResult(words[2], "failed", repr(words[0]))]
        return Shape(batch_page(jobs))

    assert page(names).found == page(["a", "b", "c"]).found


def test_recordings_with_too_long_names_do_not_affect_others(tmp_path):
    folder = tmp_path / ("r" * 250)
    folder.mkdir()
    outcome = run_job(Job(folder.name, folder, tmp_path / "out" / folder.name, None, Options()))
    assert outcome.state == "failed"
    assert np.all([entry.name in (folder.name, "out") for entry in tmp_path.iterdir()])
