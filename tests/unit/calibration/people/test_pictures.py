"""Identities of people in unrelated pictures, without a calibration."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posefuse.calibration.people.bearings import bearings_of
from posefuse.calibration.people.pictures import match_pictures, with_common_people_in_pictures
from posefuse.calibration.people.views import PeopleViews, ViewTracks
from posefuse.model.cameras import vector_from_rotation
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.figures import human
from posefuse.synthetic.rigs import build_rig
from posefuse.synthetic.walkers import Attendance, stroll

N_FRAMES = 40


@pytest.fixture(scope="module")
def room():
    """Return the views of one to three people in pictures of three cameras, in random order, and who they are."""
    rng = np.random.default_rng(4)
    rig, skeleton = build_rig("ring", 3, radius_m=4.0), find_skeleton("coco_17")
    figure = human(1.7)
    paths = [stroll((Attendance(),), 1.5, float(N_FRAMES), rng)[0] for _ in range(3)]
    points = [path.positions(figure, np.arange(float(N_FRAMES)))[:, figure.columns(skeleton)] for path in paths]
    views, owner = [], np.full((3, N_FRAMES, 3), -1)
    count = rng.integers(1, 4, N_FRAMES)
    for v, camera in enumerate(rig.cameras):
        pixels = np.full((N_FRAMES, 3, len(skeleton), 2), np.nan)
        for f in range(N_FRAMES):
            seen = [p for p in rng.permutation(count[f]) if rng.uniform() < 0.85]
            owner[v, f, : len(seen)] = seen
            for slot, p in enumerate(seen):
                pixels[f, slot] = camera.project(points[p][f])[0] + rng.normal(0.0, 4.0, (len(skeleton), 2))
        views.append(ViewTracks(camera, True, 60.0 * np.arange(N_FRAMES), pixels, np.ones(pixels.shape[:3])))
    return PeopleViews(skeleton, tuple(views), tracked=False), owner, rig


def test_pose_and_matches_of_all_frames(room):
    people, owner, rig = room
    a, b = (bearings_of(people.views[v], people.skeleton) for v in (0, 2))
    found = match_pictures(a, b)
    assert found is not None
    true = rig.cameras[2].rotation @ rig.cameras[0].rotation.T
    assert np.degrees(np.linalg.norm(vector_from_rotation(found.geometry.rotation @ true.T))) < 5.0
    right = [owner[0, f, i] == owner[2, f, j] for f, i, j in found.support]
    both = sum(len(set(owner[0, f]) & set(owner[2, f]) - {-1}) for f in range(N_FRAMES))
    assert np.mean(right) > 0.95
    assert sum(right) > 0.9 * both


def test_person_axes_agree_in_each_frame(room):
    people, owner, _ = room
    common = with_common_people_in_pictures(people)
    wrong = kept = 0
    for f in range(N_FRAMES):
        for p in range(common.views[0].keypoints_px.shape[1]):
            of_frame = []
            for v, view in enumerate(common.views):
                if np.isfinite(view.keypoints_px[f, p]).any():
                    same = [
                        np.array_equal(view.keypoints_px[f, p], each, equal_nan=True)
                        for each in people.views[v].keypoints_px[f]
                    ]
                    of_frame.append(owner[v, f, same.index(True)])
            kept += len(of_frame)
            wrong += len(of_frame) - max([of_frame.count(each) for each in of_frame], default=0)
            assert len(of_frame) != 1
    assert wrong <= 0.03 * kept
    assert kept > 0.85 * (owner >= 0).sum()


def test_unrelated_views_have_no_pose_or_few_matches(room):
    """A camera that was turned at random in every picture."""
    people, _, _ = room
    rng = np.random.default_rng(1)
    a, b = (bearings_of(people.views[v], people.skeleton) for v in (0, 1))
    turns = Rotation.random(N_FRAMES, rng=rng).as_matrix()
    turned = np.einsum("fij,fpkj->fpki", turns, b.rays)
    found = match_pictures(a, type(b)(**{**vars(b), "rays": turned}))
    both = sum(min(np.isfinite(v.rays[f, :, 0, 0]).sum() for v in (a, b)) for f in range(N_FRAMES))
    assert found is None or len(found.support) < 0.6 * both
