"""Options that depend on the recording."""

from dataclasses import replace

import pytest

from posefuse.model.options.left_right import SideOptions
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.defaults import (
    RecordingFacts,
    resolve_chunk_frames,
    resolve_pairs,
    resolve_people,
    unused_side_options,
)
from posefuse.skeleton.skeletons import Skeleton, find_skeleton

FACTS = RecordingFacts(100, 3, 300, True, True, 20.0, find_skeleton("coco_17"))


@pytest.mark.parametrize("smoother", ["none", "lag", "full"])
@pytest.mark.parametrize("people", ["one", "many"])
def test_no_smoother_changes_how_pairs_are_solved(people, smoother):
    options = Options(people=people, tracker=TrackerOptions(smoother=smoother))
    assert resolve_pairs(options, 3, FACTS.skeleton).pairs == "enumerate"


@pytest.mark.parametrize("tree", [True, False])
def test_auto_keeps_everyone_if_a_view_shows_several(tree):
    skeleton = FACTS.skeleton if tree else Skeleton("mouse", ("nose", "tail"))
    facts = replace(FACTS, skeleton=skeleton)
    assert resolve_people(Options(), facts, 3).people == "many"
    assert resolve_people(Options(), facts, 1).people == "one"
    assert resolve_people(Options(pick="largest"), facts, 3).people == "one"
    assert resolve_people(Options(), replace(facts, several_people=False), 3).people == "one"


@pytest.mark.parametrize(
    ("people", "skeleton", "expected"),
    [(2, "coco_17", 2048), (2, "coco_wholebody_133", 1024), (4, "coco_wholebody_133", 542), (50, "coco_17", 339)],
)
def test_chunks_of_many_keypoints_are_shorter_and_whole_blocks_where_they_are_longer(people, skeleton, expected):
    facts = replace(
        FACTS, n_frames=10_000, n_views=8, n_detections=8 * people * 10_000, skeleton=find_skeleton(skeleton)
    )
    assert resolve_chunk_frames(Options(), facts).chunk_frames == expected
    assert resolve_chunk_frames(Options(chunk_frames=100), facts).chunk_frames == 100


def test_side_options_without_effect_are_noted():
    assert unused_side_options(Options(pairs="enumerate", sides="votes")) == ()
    assert unused_side_options(Options(pairs="labels")) == ()
    assert unused_side_options(Options(pairs="labels", sides="votes"))[0].startswith("sides has no effect")
    search = SideOptions(swap_duration_s=2.0)
    note = unused_side_options(Options(pairs="labels", sides="plane", side_search=search))[0]
    assert note.startswith("sides and side_search have no effect")
