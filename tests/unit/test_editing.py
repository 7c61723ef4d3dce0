"""Edits have hand-computed effects, can undo each other, and report errors with a suggestion."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.editing import apply_edits, edited_chunks
from posefuse.errors import EditError
from posefuse.io.edits import edits_to_toml, read_edits
from posefuse.model.edits import Drop, Edit, Merge, Rename, Split, Swap, name_of
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus
from posefuse.model.track_events import EVENT_KINDS, Event
from posefuse.model.tracks import TrackState
from tests.people import simulate_walkers, track_perfectly, without_people
from tests.properties import examples

FRAMES = 30


@pytest.fixture(scope="module")
def scene():
    return simulate_walkers(seconds=FRAMES / 25)


@pytest.fixture(scope="module")
def result(scene) -> Reconstruction:
    return track_perfectly(scene)


def data_of(result: Reconstruction, person: str, frames: slice = slice(None)) -> list[np.ndarray]:
    """Return all frame-by-frame data of a person."""
    p = result.person_ids.index(person)
    sources = [value for layer in result.layers.values() for value in vars(layer).values()]
    sources += [result.tracks.detection, result.tracks.state, result.swaps.state]
    sources += [result.poses.turns, result.poses.directions]
    return [np.asarray(source)[frames, p] for source in sources]


def assert_same(first: list[np.ndarray], second: list[np.ndarray]) -> None:
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


def without_notes(result: Reconstruction) -> Reconstruction:
    return replace(result, provenance=replace(result.provenance, notes=()), events=())


class TestEffects:
    def test_rename(self, result):
        edited = apply_edits(result, [Rename("person_2", "Änne")])
        assert edited.person_ids == ("person_1", "Änne", "person_3", "person_4")
        assert_same(data_of(edited, "Änne"), data_of(result, "person_2"))
        first = [(e.number, e.what) for e in edited.events if e.person == "Änne"]
        assert first == [(e.number, e.what) for e in result.events if e.person == "person_2"]
        assert first
        assert edited.provenance.notes == ("a note", "Edited: person_2 renamed to Änne.")
        np.testing.assert_array_equal(edited.poses.shape_m, result.poses.shape_m)

    def test_split(self, result):
        edited = apply_edits(result, [Split("person_1", "late", 12)])
        assert edited.person_ids == ("person_1", "late", "person_2", "person_3", "person_4")
        early, late, then = slice(None, 12), slice(12, None), data_of(result, "person_1", slice(12, None))
        assert_same(data_of(edited, "person_1", early), data_of(result, "person_1", early))
        assert_same(data_of(edited, "late", late), then)
        layer = edited.layers["model"]
        assert np.isnan(np.asarray(layer.points_m)[:12, 1]).all()
        assert np.isnan(np.asarray(layer.points_m)[12:, 0]).all()
        assert (np.asarray(layer.status)[12:, 0] == PointStatus.ABSENT).all()
        assert (np.asarray(edited.tracks.detection)[:12, 1] == -1).all()
        np.testing.assert_array_equal(edited.poses.shape_m[[0, 1]], result.poses.shape_m[[0, 0]])

    def test_drop_a_person(self, result):
        edited = apply_edits(result, [Drop("person_2")])
        assert edited.person_ids == ("person_1", "person_3", "person_4")
        assert_same(data_of(edited, "person_3"), data_of(result, "person_3"))
        assert {event.person for event in edited.events} <= set(edited.person_ids)
        np.testing.assert_array_equal(edited.poses.shape_m, result.poses.shape_m[[0, 2, 3]])

    def test_drop_includes_the_last_frame(self, result):
        edited = apply_edits(result, [Drop("person_2", 5, 9), Drop(to_frame=1)])
        missing = np.isnan(np.asarray(edited.layers["measured"].points_m)).all(axis=(2, 3))
        assert np.flatnonzero(missing[:, 1]).tolist() == [0, 1, 5, 6, 7, 8, 9]
        assert missing[:2].all()
        assert_same(data_of(edited, "person_3", slice(2, None)), data_of(result, "person_3", slice(2, None)))

    def test_swap(self, result):
        edited = apply_edits(result, [Swap(("person_1", "person_3"), 10)])
        before, after = slice(None, 10), slice(10, None)
        assert_same(data_of(edited, "person_1", before), data_of(result, "person_1", before))
        assert_same(data_of(edited, "person_1", after), data_of(result, "person_3", after))
        assert_same(data_of(edited, "person_3", after), data_of(result, "person_1", after))

    def test_merge_joins_two_tracks_of_one_person(self, result):
        cut = apply_edits(result, [Split("person_1", "late", 12)])
        state = np.array(cut.tracks.state)
        state[12:15, 0] = TrackState.LOST  # The old track is lost, not yet terminated, when the new one is confirmed.
        again = Event(12, 0.48, "late", "confirmed", "seen by 4 cameras")
        cut = replace(cut, tracks=replace(cut.tracks, state=state), events=(*cut.events, again))
        edited = apply_edits(cut, [Merge("late", "person_1")])
        assert_same(data_of(edited, "person_1"), data_of(result, "person_1"))
        events = [event for event in edited.events if event.number == 12]
        assert events == [Event(12, 0.48, "person_1", "reidentified", "seen by 4 cameras (then called late)")]

    def test_merge_keeps_the_termination_event_of_the_merged_person(self, result):
        cut = apply_edits(result, [Split("person_4", "late", 5)])
        edited = apply_edits(cut, [Merge("late", "person_4")])
        events = {(e.number, e.what) for e in edited.events}
        assert events == {(e.number, e.what) for e in result.events}
        assert "terminated" in {e.what for e in edited.events}
        assert edited.person_ids == result.person_ids

    def test_merge_of_two_active_people_needs_keep(self, result):
        with pytest.raises(EditError, match=r"both active in \d+ frames .*choose whose frames to keep there: keep"):
            apply_edits(result, [Merge("person_2", "person_1")])
        edited = apply_edits(result, [Merge("person_2", "person_1", keep="person_2")])
        active = np.asarray(result.tracks.state)[:, 1] == TrackState.ACTIVE
        first, second = data_of(edited, "person_1"), data_of(result, "person_2")
        assert_same([m[active] for m in first], [t[active] for t in second])
        assert edited.provenance.notes[-1] == "Edited: person_2 merged into person_1, person_2 where both were active."

    def test_camera_events_are_kept(self, result):
        event = Event(3, 0.12, "cam_1", "camera_rejected", "it disagrees with the others")
        edited = apply_edits(replace(result, events=(event,)), [Drop("person_1"), Rename("person_2", "b")])
        assert edited.events == (event,)


def test_documented_example_is_valid(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "people.md").read_text()
    (tmp_path / "edits.toml").write_text(page.split("```toml")[1].split("```")[0])
    assert [name_of(edit) for edit in read_edits(tmp_path / "edits.toml")] == [
        "merge", "split", "swap", "rename", "drop", "drop",
    ]  # fmt: skip
    assert all(f"`{what}`" in page for what in EVENT_KINDS)


names = st.sampled_from([f"person_{i}" for i in range(1, 5)])
frames = st.integers(1, FRAMES - 1)


class TestProperties:
    @examples(15)
    @given(a=names, b=names, frame=frames)
    def test_swap_twice_restores_the_result(self, result, a, b, frame):
        if a != b:
            edited = apply_edits(result, [Swap((a, b), frame), Swap((b, a), frame)])
            assert without_notes(edited) == without_notes(result)
            assert edited.events == result.events

    @pytest.mark.parametrize("person", [f"person_{i}" for i in range(1, 5)])
    def test_merge_undoes_a_split_at_any_frame(self, result, person):
        """Merging undoes a split even at the frame in which a track terminates: the event must not get lost."""
        present = np.asarray(result.tracks.state)[:, result.person_ids.index(person)] != TrackState.ABSENT
        second = data_of(result, person)
        for frame in range(1, FRAMES):
            edited = apply_edits(result, [Split(person, "new", frame), Merge("new", person)])
            assert_same([m[present] for m in data_of(edited, person)], [t[present] for t in second])
            assert [(e.number, e.person, e.what) for e in edited.events] == [
                (e.number, e.person, e.what) for e in result.events
            ]

    @examples(10)
    @given(size=st.integers(1, FRAMES), seed=st.integers(0, 1000))
    def test_edited_chunks_equal_edits_in_memory(self, result, size, seed):
        at = 1 + seed % (FRAMES - 1)
        edits = [Split("person_1", "x", at), Swap(("x", "person_4"), FRAMES // 2), Drop("person_2"), Drop("x", at, at)]
        whole = apply_edits(result, edits)
        assert Reconstruction.concatenate(list(edited_chunks(result, edits, size))) == whole
        assert apply_edits(result, edits) == whole

    def test_original_is_not_modified(self, result, scene):
        apply_edits(result, [Drop("person_2", 3, 5), Swap(("person_1", "person_3"), 4)])
        assert result == track_perfectly(scene)

    def test_all_people_can_be_dropped(self, result, scene):
        edited = apply_edits(result, [Drop(name) for name in result.person_ids])
        assert edited.layers["model"] == without_people(scene).layers["model"]
        assert (edited.person_ids, edited.events) == ((), ())


class TestErrors:
    @pytest.mark.parametrize(
        ("edit", "words"),
        [
            (Rename("person_9", "x"), "No person is called 'person_9'. Did you mean"),
            (Rename("person_1", "person_2"), "A person is already called 'person_2'; the names are person_1, person_2"),
            (Split("person_1", "person_3", 5), "A person is already called 'person_3'"),
            (Split("person_1", "x", 0), "no frames would remain for person_1"),
            (Split("person_1", "x", 99), "from_frame 99 is not in this result, which has frames 0 to 29"),
            (Drop("person_1", to_frame=30), "to_frame 30 is not in this result"),
            (Swap(("person_1", "bert"), 3), "No person is called 'bert'. Choose one of: person_1"),
        ],
    )
    def test_unknown_people_and_frames_raise(self, edit, words, result):
        with pytest.raises(EditError, match=rf"^Edit 2 \({type(edit).__name__.lower()}\): ") as caught:
            apply_edits(result, [Drop("person_4", 3, 4), edit])
        assert words in str(caught.value)

    def test_unrecorded_frame_raises(self, result):
        gap = replace(result, frame_numbers=np.r_[0:10, 20:40])
        with pytest.raises(EditError, match="from_frame 15 was not recorded; the nearest recorded frames are 9 and 20"):
            apply_edits(gap, [Split("person_1", "x", 15)])

    def test_edits_are_checked_before_the_first_range(self, result):
        with pytest.raises(EditError):
            edited_chunks(result, [Drop("unknown")])

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("", "contains no [[edit]]. Each needs do = one of merge, split"),
            ("[edit]\ndo = 'drop'\n", "write each edit as its own table [[edit]], with two brackets"),
            ("[[merge]]\n", "unknown key 'merge'. Edits are tables [[edit]]"),
            ("[[edit]]\nperson = 'a'\n", "e.toml, edit 1: the key 'do' is missing. Set it to one of: merge"),
            ("[[edit]]\ndo = 'merg'\n", "edit 1: unknown operation do = 'merg'. Did you mean 'merge'?"),
            ("[[edit]]\ndo = 'merge'\nperson = 'a'\n", "edit 1 (merge): into is missing. Required keys: person, into."),
            ("[[edit]]\ndo = 'drop'\nframe = 3\n", "(drop): unknown key 'frame'. Keys: person, from_frame, to_frame."),
            ("[[edit]]\ndo = 'drop'\n", "drop needs at least one of person, from_frame and to_frame"),
            ("[[edit]]\ndo = 'drop'\nfrom_frame = 5\nto_frame = 3\n", "to_frame (3) is before from_frame (5)"),
            ("[[edit]]\ndo = 'drop'\nperson = 3\n", "person cannot be 3. Expected `str | null`, got `int`."),
            ("[[edit]]\ndo = 'swap'\npeople = ['a', 'a']\nfrom_frame = 1\n", "two different names in people"),
            ("[[edit]]\ndo = 'rename'\nperson = 'a'\nto = 'b/c'\n", "it is part of file names and contains '/'"),
            ("[[edit]]\ndo = 'merge'\nperson = 'a'\ninto = 'b'\nkeep = 'c'\n", "keep must be 'a' or 'b'"),
            ("[[edit]]\ndo = 'merge'\nperson = 'a'\ninto = 'a'\n", "merge needs two different names"),
        ],
    )
    def test_invalid_files_raise(self, text, words, tmp_path):
        (tmp_path / "e.toml").write_text(text)
        with pytest.raises(EditError) as caught:
            read_edits(tmp_path / "e.toml")
        assert words in str(caught.value)


@examples(100)
@given(
    st.lists(
        st.one_of(
            st.builds(Merge, st.just("a"), st.just("b"), st.sampled_from([None, "a", "b"])),
            st.builds(Split, st.text("xyz", min_size=1), st.text("xyzäß", min_size=1), st.integers(0, 10**6)),
            st.builds(Rename, st.text(min_size=1), st.text("nöm", min_size=1)),
            st.builds(Drop, st.text("pq", min_size=1), st.none() | st.integers(0, 9), st.none() | st.integers(9, 99)),
            st.builds(Swap, st.just(("a", "b")), st.integers(0, 99)),
        ),
        min_size=1,
    )
)
def test_files_round_trip(tmp_path_factory, edits: list[Edit]):
    path = tmp_path_factory.getbasetemp() / "edits.toml"
    path.write_text(edits_to_toml(edits), "utf-8")
    assert read_edits(path) == tuple(edits)
