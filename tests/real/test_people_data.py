"""Real people that association and tracking are scored on, read as they are."""

import numpy as np
import pytest
from benchmarks import mvor, panoptic

from posefuse import Options


@pytest.fixture(scope="module")
def operating_room():
    cache = {}

    def read(shared_data):
        if not cache:
            cache["data"] = mvor.read_mvor(shared_data("mvor"))
        return cache["data"]

    return read


def test_mvor_truth_reprojects(operating_room, shared_data):
    data = operating_room(shared_data)
    assert (data.detections.n_frames, int(data.detections.offsets[-1])) == (732, 4091)
    assert sum(len(each) for each in data.truth_m) == 1057
    errors = []
    for points, persons, annotated in zip(data.truth_m, data.persons, data.annotated_px, strict=True):
        pixels = data.rig.project(points[None])[0]
        for v, of_view in enumerate(annotated):
            errors += [pixels[v, t] - of_view[person] for t, person in enumerate(persons) if person in of_view]
    assert np.nanmedian(np.linalg.norm(errors, axis=-1)) < 9.0


def test_oracle_error_in_mvor(operating_room, shared_data):
    """The notes of the data state 60 mm with three views and 83 mm with two, without naming the joints."""
    data = operating_room(shared_data)
    points, _ = mvor.oracle(data)
    actual = mvor.score(data, [each[np.isfinite(each).all(axis=-1).any(axis=-1)] for each in points])
    assert actual.oracle_error_mm_by_views[3] == pytest.approx(60, rel=0.1)
    assert actual.oracle_error_mm_by_views[2] == pytest.approx(83, rel=0.1)
    assert actual.error_mm == pytest.approx(actual.oracle_error_mm)
    assert actual.relative_recall == 1
    assert actual.false_share == 0


def test_proposals_in_mvor(operating_room, shared_data):
    """Proposals match nearly all people of the oracle with similar errors."""
    data = operating_room(shared_data)
    actual = mvor.score(data, mvor.proposed(data, "groups"))
    assert actual.relative_recall >= 0.95
    assert actual.error_mm_by_views[3] <= 1.1 * 60
    assert actual.error_mm_by_views[2] <= 1.1 * 83
    assert actual.false_share <= 0.05


@pytest.mark.long
def test_unrelated_frames_of_mvor_are_reconstructed_without_tracking(operating_room, shared_data):
    """Tracking across 75 s finds 0.4 of the oracle's people."""
    data = operating_room(shared_data)
    actual = mvor.score(data, mvor.reconstructed(data, Options(health="off")))
    assert actual.relative_recall >= 0.95
    assert actual.error_mm <= 70
    assert actual.error_mm < actual.oracle_error_mm
    assert actual.false_share <= 0.05


def test_displaced_proposals_are_false_in_mvor(operating_room, shared_data):
    """The same people a meter aside."""
    data = operating_room(shared_data)
    points, _ = mvor.oracle(data)
    away = [each[np.isfinite(each).all(axis=-1).any(axis=-1)] + np.array([1.0, 0.0, 0.0]) for each in points]
    actual = mvor.score(data, away)
    assert actual.relative_recall < 0.2
    assert actual.false_share > 0.3


def test_panoptic_people_stand_on_the_floor(shared_data):
    """Heads above ankles along -y, bones of human size, and inside the images of the chosen cameras."""
    folder = shared_data("panoptic_motion").parent
    for motion in (panoptic.one_person(folder), panoptic.three_people(folder)):
        named = {name: motion.points_m[:, :, k] for k, name in enumerate(motion.skeleton.keypoints)}
        assert motion.rig.up_axis == "-y"
        assert np.nanmedian(named["right_ankle"][..., 1] - named["nose"][..., 1]) > 0.7
        assert np.nanmedian(np.linalg.norm(named["left_hip"] - named["left_knee"], axis=-1)) == pytest.approx(
            0.4, abs=0.1
        )
        pixels = motion.rig.project(motion.points_m[::50])
        width, height = motion.rig.cameras[0].size_px
        inside = (pixels >= 0).all(axis=-1) & (pixels[..., 0] < width) & (pixels[..., 1] < height)
        assert inside.mean() > 0.6
    assert motion.points_m.shape == (20, 3, 19, 3)
