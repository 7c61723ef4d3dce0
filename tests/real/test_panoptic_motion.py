"""Motion of real people, before real lenses, through the simulated detector of crowds."""

import numpy as np
import pytest
from benchmarks import panoptic

from posefuse import Options, reconstruct
from posefuse.synthetic.crowds import CrowdScene, Kind, crowd_of_points


def check(scene: CrowdScene, points_m: np.ndarray) -> None:
    """Most cameras detect every person close to the true position."""
    actual = scene.detections
    cell = np.repeat(np.arange(actual.n_frames * actual.n_views), actual.people_counts.ravel())
    frame, view = cell // actual.n_views, cell % actual.n_views
    person = scene.kind == Kind.PERSON
    exact = scene.rig.project(points_m)[frame, view, scene.owner][person]
    error = np.linalg.norm(np.asarray(actual.keypoints_px)[person] - exact, axis=-1)
    # 4.5 px / c at 1000 px is 11.5 px at 1920 and c = 0.75; the median norm of two such errors is half as much again.
    assert np.nanmedian(error) == pytest.approx(18.0, abs=6.0)
    visible = np.zeros((actual.n_frames, points_m.shape[1], actual.n_views), dtype=bool)
    visible[frame[person], scene.owner[person], view[person]] = True
    assert (visible.sum(axis=2) >= 3).mean() > 0.95


def test_single_person(shared_data):
    motion = panoptic.one_person(shared_data("panoptic_motion").parent)
    points = motion.points_m[:600]
    check(crowd_of_points(points, motion.rig, motion.skeleton, motion.rate_hz), points)


@pytest.mark.parametrize("sequence", ["160906_band1", "160906_band2"])
def test_three_people(shared_data, sequence):
    motion = panoptic.three_people(shared_data("panoptic_three_people").parent, sequence)
    assert motion.points_m.shape == (20, 3, 19, 3)
    check(crowd_of_points(motion.points_m, motion.rig, motion.skeleton, motion.rate_hz), motion.points_m)


def test_leg_that_is_detected_late_is_tracked(shared_data):
    """The first frames show no leg of a sitting person, whose direction is far from the rest pose."""
    motion = panoptic.three_people(shared_data("panoptic_three_people").parent)
    scene = crowd_of_points(motion.points_m, motion.rig, motion.skeleton, motion.rate_hz)
    result = reconstruct(scene.rig, scene.detections, Options(people="many"))
    actual = np.asarray(result.layers["model"].points_m)
    errors_m = np.linalg.norm(actual[:, :, None] - motion.points_m[:, None], axis=-1)
    first = np.nanmedian(errors_m, axis=(0, 3)).argmin(axis=0)
    assert len(set(first.tolist())) == 3
    knee = motion.skeleton.index("right_knee")
    assert all(np.nanmedian(errors_m[:, p, t, knee]) < 0.1 for t, p in enumerate(first))
