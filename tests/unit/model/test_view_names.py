"""Names of views and cameras."""

import pytest

from posefuse.model.view_names import has_name


@pytest.mark.parametrize(
    ("view", "camera", "has"),
    [("2019-08-02-vid01-camA", "A", True), ("trial_top", "Top", True), ("trial_1", "10", False), ("camAB", "A", False)],
)
def test_camera_name_matches_a_word_of_the_view_name(view, camera, has):
    assert has_name(view, camera) == has
