"""Simulated animals: where they go, how they turn, and that a scene is the same at every frame rate."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.animal_scenes import AnimalOptions, renamed, simulate_animals

from posefuse.errors import OptionsError, SkeletonError
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton
from posefuse.synthetic.crowds import CrowdScene
from posefuse.synthetic.options import CLEAN

FEW = AnimalOptions(animals=2, cameras=3, duration_s=6.0, rate_hz=20.0, seed=3)


def points_of(scene: CrowdScene) -> np.ndarray:
    """Shape (frame, animal, keypoint, 3)."""
    return np.asarray(scene.truth.layers["measured"].points_m)


@pytest.fixture(scope="module")
def scene() -> CrowdScene:
    return simulate_animals(FEW)


def test_seed_determines_the_bytes(scene: CrowdScene) -> None:
    again, other = simulate_animals(FEW), simulate_animals(replace(FEW, seed=4))
    assert again.detections.keypoints_px.tobytes() == scene.detections.keypoints_px.tobytes()
    assert points_of(again).tobytes() == points_of(scene).tobytes()
    assert not np.allclose(points_of(other), points_of(scene))


def test_scene_is_independent_of_the_frame_rate(scene: CrowdScene) -> None:
    twice = simulate_animals(replace(FEW, rate_hz=40.0))
    np.testing.assert_allclose(points_of(twice)[::2], points_of(scene), atol=1e-12)


def test_animals_stay_on_the_floor_of_the_arena_and_do_not_overlap(scene: CrowdScene) -> None:
    middles = points_of(scene)[..., shipped_skeleton("mouse_22").core_indices, :].mean(axis=2)
    assert np.abs(middles[..., :2]).max() < 0.5 * FEW.arena_m
    assert (middles[..., 2] > 0.0).all()
    assert (middles[..., 2] < 0.1).all()
    roots = points_of(scene)[:, :, shipped_skeleton("mouse_22").index("spine_middle")]
    assert np.linalg.norm(roots[:, 0] - roots[:, 1], axis=-1).min() > 0.015


def test_one_animal_does_not_move() -> None:
    still = points_of(simulate_animals(replace(FEW, scenario="still")))
    roots = still[:, :, shipped_skeleton("mouse_22").index("spine_middle")]
    assert np.ptp(roots[:, 0], axis=0).max() < 0.01
    assert np.ptp(roots[:, 1], axis=0).max() > 0.05


def test_tank_has_no_up_axis() -> None:
    points = points_of(simulate_animals(replace(FEW, scenario="free", duration_s=20.0)))
    skeleton = shipped_skeleton("mouse_22")
    back, shoulders = points[:, 0, skeleton.index("spine_front")], ("left_shoulder", "right_shoulder")
    below = back - points[:, 0, [skeleton.index(name) for name in shoulders]].mean(axis=1)
    assert below[:, 2].min() < -0.007
    assert below[:, 2].max() > 0.007


def test_clean_detections_match_the_projected_truth(scene: CrowdScene) -> None:
    clean = simulate_animals(replace(FEW, detector=replace(CLEAN, sigma_px=0.0), duration_s=1.0))
    other = clean.kind == 0
    frame = np.repeat(np.arange(20 * 3), np.diff(clean.detections.offsets))[other]
    own = points_of(clean)[frame // 3, clean.owner[other]]
    for v, camera in enumerate(clean.rig.cameras):
        first = frame % 3 == v
        off = np.linalg.norm(camera.project(own[first])[0] - clean.detections.keypoints_px[other][first], axis=-1)
        assert np.nanmax(off) < 1e-6


def test_second_detector_has_other_keypoints(scene: CrowdScene) -> None:
    own = renamed(scene, Skeleton("own", ("tail", "nose")), {"tail": "tail_base", "nose": "snout"})
    mouse = shipped_skeleton("mouse_22")
    np.testing.assert_array_equal(points_of(own)[:, :, 1], points_of(scene)[:, :, mouse.index("snout")])
    np.testing.assert_array_equal(
        own.detections.keypoints_px[:, 0], scene.detections.keypoints_px[:, mouse.index("tail_base")]
    )


def test_invalid_scenes_are_errors() -> None:
    with pytest.raises(OptionsError, match="No scenario 'tank'"):
        AnimalOptions(scenario="tank")  # type: ignore[arg-type]
    with pytest.raises(OptionsError, match="1 animal and 2 cameras, got animals=1, cameras=1"):
        AnimalOptions(animals=1, cameras=1)
    with pytest.raises(OptionsError, match="must be positive"):
        AnimalOptions(rate_hz=0.0)
    with pytest.raises(SkeletonError, match="which a simulated animal needs"):
        simulate_animals(AnimalOptions(skeleton="coco_wholebody_133"))
