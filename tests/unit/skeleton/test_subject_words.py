"""Animals are called animals."""

import pytest

from posefuse.skeleton.from_names import skeleton_of
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.skeleton.subject_words import count_subjects, subject_words


@pytest.mark.parametrize(
    ("name", "words"),
    [("halpe_26", "people"), ("mediapipe_holistic_553", "people"), ("mouse_22", "animals"), ("fly_38", "animals")],
)
def test_words_suit_the_skeleton(name, words):
    assert subject_words(find_skeleton(name))[1] == words


@pytest.mark.parametrize(
    ("keypoints", "one", "several"),
    [
        (("Nose", "TailTip"), "1 animal", "2 animals"),
        (("nose", "Left_Hip"), "1 person", "2 people"),
        (("corner_1", "corner_2"), "1 subject", "2 subjects"),
    ],
)
def test_names_of_keypoints_decide_whatever_their_case(keypoints, one, several):
    skeleton = skeleton_of("own", keypoints)
    assert [count_subjects(n, skeleton) for n in (1, 2)] == [one, several]
