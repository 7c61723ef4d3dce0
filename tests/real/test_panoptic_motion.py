"""Motion of real people, before real lenses, through the simulated detector of crowds."""

import numpy as np
import pytest
from benchmarks import panoptic

from posefuse.synthetic.crowds import CrowdScene, Kind, crowd_of_points


def check(scene: CrowdScene, points_m: np.ndarray) -> None:
    """Everybody is seen by most cameras, near where they are."""
    found = scene.detections
    cell = np.repeat(np.arange(found.n_frames * found.n_views), found.people_counts.ravel())
    frame, view = cell // found.n_views, cell % found.n_views
    person = scene.kind == Kind.PERSON
    exact = scene.rig.project(points_m)[view, frame, scene.owner][person]
    error = np.linalg.norm(np.asarray(found.keypoints_px)[person] - exact, axis=-1)
    # 4.5 px / c at 1000 px is 11.5 px at 1920 and c = 0.75; the median norm of two such errors is half as much again.
    assert np.nanmedian(error) == pytest.approx(18.0, abs=6.0)
    seen = np.zeros((found.n_frames, points_m.shape[1], found.n_views), dtype=bool)
    seen[frame[person], scene.owner[person], view[person]] = True
    assert (seen.sum(axis=2) >= 3).mean() > 0.95


def test_one_person(shared_data):
    folder = shared_data("panoptic_motion")
    points = panoptic.read_one_person(folder)[:600]
    rig = panoptic.read_rig(folder / "calibration_171026_pose3.json")
    check(crowd_of_points(points, rig, panoptic.skeleton(), panoptic.RATE_HZ), points)


@pytest.mark.parametrize("sequence", ["160906_band1", "160906_band2"])
def test_three_people(shared_data, sequence):
    folder = shared_data("panoptic_three_people") / sequence
    points = panoptic.read_people(folder)
    assert points.shape == (20, 3, 19, 3)
    rig = panoptic.read_rig(next(folder.glob("calibration_*.json")))
    check(crowd_of_points(points, rig, panoptic.skeleton(), panoptic.RATE_HZ), points)
