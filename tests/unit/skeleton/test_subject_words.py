"""Animals are called animals."""

from dataclasses import replace

import pytest

from posefuse.skeleton.skeletons import find_skeleton
from posefuse.skeleton.subject_words import count_subjects, subject_words


@pytest.mark.parametrize(
    ("name", "words"),
    [("halpe_26", "people"), ("mediapipe_holistic_553", "people"), ("mouse_22", "animals"), ("fly_38", "animals")],
)
def test_words_suit_the_skeleton(name, words):
    assert subject_words(find_skeleton(name))[1] == words


def test_names_of_keypoints_decide_whatever_their_case():
    skeleton = find_skeleton("panoptic_19")
    keypoints = ("Nose", "TailTip", *skeleton.keypoints[2:])
    assert (
        count_subjects(
            1,
            replace(
                skeleton,
                keypoints=keypoints,
                edges=(),
                pairs=(),
                chains={},
                derived={},
                rigid=(),
                plausible_m=(),
                names={},
                core=(),
                tree=None,
                parts=(),
            ),
        )
        == "1 animal"
    )
    assert count_subjects(2, skeleton) == "2 people"


def test_objects_are_subjects():
    skeleton = find_skeleton("panoptic_19")
    corners = tuple(f"corner_{i}" for i in range(len(skeleton)))
    assert (
        count_subjects(
            2,
            replace(
                skeleton,
                keypoints=corners,
                edges=(),
                pairs=(),
                chains={},
                derived={},
                rigid=(),
                plausible_m=(),
                names={},
                core=(),
                tree=None,
                parts=(),
            ),
        )
        == "2 subjects"
    )
