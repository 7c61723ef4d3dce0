"""People of a recording whose views show several animals, with and without a kinematic tree."""

from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import Skeleton, parse_skeleton
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from tests.scenes import ring, simulate_detections

_LEGS, _JOINTS = 6, 4
_KEYPOINTS = tuple(f"leg{leg}_{joint}" for leg in range(_LEGS) for joint in range(_JOINTS))
_EDGES = [[f"leg{leg}_{joint}", f"leg{leg}_{joint + 1}"] for leg in range(_LEGS) for joint in range(_JOINTS - 1)]


def six_legs(n: int, rng: np.random.Generator) -> np.ndarray:
    """Return six legs that swing about the corners of a rigid body without keypoints, shape (n, keypoint, 3)."""
    time = np.arange(n) / 60.0
    phase = rng.uniform(0, 2 * np.pi, (_LEGS, _JOINTS))
    points = np.empty((n, _LEGS, _JOINTS, 3))
    for leg in range(_LEGS):
        points[:, leg, 0] = [0.3 * np.cos(leg), 0.3 * np.sin(leg), 1.0]
        for joint in range(1, _JOINTS):
            swing = leg + 0.6 * np.sin(2 * np.pi * time + phase[leg, joint])
            down = -0.6 + 0.3 * np.sin(4 * time + phase[leg, joint])
            bone = np.stack([np.cos(swing), np.sin(swing), down], axis=1)
            points[:, leg, joint] = points[:, leg, joint - 1] + 0.15 * bone / np.linalg.norm(bone, axis=1)[:, None]
    return points.reshape(n, -1, 3)


def two_blobs(n: int, skeleton: Skeleton, rng: np.random.Generator):
    """Return detections of two bodies in random order; the second leaves after half of the time."""
    rig, shape = ring(4), rng.uniform(-0.15, 0.15, (6, 3))
    way = 0.3 * np.sin(np.arange(n)[:, None] / 20.0 + np.array([0.0, 1.0, 2.0]))
    centers = np.stack([way + np.array([0.8, 0.0, 0.9]), way + np.array([-0.8, 0.0, 0.9])], axis=1)
    points = centers[:, :, None] + shape
    pixels = rig.project(points) + rng.normal(0.0, 1.0, (n, 4, 2, 6, 2))
    rows, counts = [], []
    for frame in range(n):
        for view in range(4):
            order = rng.permutation(2) if frame < n // 2 else [0]
            rows += [pixels[frame, view, person] for person in order]
            counts.append(len(order))
    return rig, points, posefuse.Detections(
        skeleton=skeleton, view_names=rig.names, frame_numbers=np.arange(n),
        time_s=np.repeat(np.arange(n)[:, None] / 60.0, 4, axis=1), offsets=np.concatenate([[0], np.cumsum(counts)]),
        keypoints_px=np.array(rows), confidence=np.ones((len(rows), 6)), recorded=np.ones((n, 4), dtype=bool),
        track_ids=np.full(len(rows), -1), rate_hz=60.0,
    )  # fmt: skip


def test_view_errors_of_a_body_are_those_of_the_selected_detections(rng):
    rig, points, detections = two_blobs(120, Skeleton("blob", tuple("abcdef")), rng)
    # The subject is as large as the other; its identity selects it, in any place of the list.
    shown = np.array([rig.project(points[:, p]) for p in (0, 1)])
    frame, view = np.divmod(np.repeat(np.arange(120 * 4), np.diff(detections.offsets)), 4)
    distance = np.linalg.norm(shown[:, frame, view] - detections.keypoints_px, axis=-1).mean(axis=-1)
    detections = replace(detections, track_ids=distance.argmin(axis=0))
    result = posefuse.reconstruct(rig, detections, Options(people="one", pick="track-id", bodies="fit", health="off"))
    layer = result.layers["model"]
    assert result.tracks is not None
    assert (np.asarray(result.tracks.detection) == 1).any()
    assert np.nanmax(layer.view_error_px) < 20.0
    again = rig.project(np.asarray(layer.points_m)[:, 0])
    pixels = np.asarray(detections.keypoints_px)[result.tracks.rows(detections)[:, 0]]
    assert np.allclose(
        layer.view_error_px[:, 0].swapaxes(1, 2), np.linalg.norm(again - pixels, axis=-1), equal_nan=True
    )


def test_auto_keeps_everyone_without_a_kinematic_tree(rng):
    rig, _, detections = two_blobs(120, Skeleton("blob", tuple("abcdef")), rng)
    result = posefuse.reconstruct(rig, detections)
    assert len(result.person_ids) == 2


def test_one_person_is_the_one_who_stays_longest_in_the_common_volume(rng):
    rig, points, detections = two_blobs(120, Skeleton("blob", tuple("abcdef")), rng)
    result = posefuse.reconstruct(rig, detections, posefuse.Options(people="one"))
    assert result.person_ids == ("person_1",)
    measured = result.layers["measured"].points_m[:, 0]
    assert np.isfinite(measured).mean() > 0.9
    assert np.nanmax(np.linalg.norm(measured - points[:, 0], axis=-1)) < 0.05
    assert any(
        "stays longest in the common volume: 100% of the time in sight of 4 cameras" in note
        for note in result.provenance.notes
    )


@pytest.mark.parametrize(("people", "bodies"), [("many", "auto"), pytest.param("one", "fit", marks=pytest.mark.long)])
def test_bodies_of_legs_that_no_edge_connects_have_all_legs(rng, people, bodies):
    text = f"name = 'legs'\nkeypoints = {list(_KEYPOINTS)}\nedges = {_EDGES}\n[tree]\nsize_m = 1.0\n"
    skeleton, rig, points = parse_skeleton(text, "legs.toml"), ring(5), six_legs(180, rng)
    assert len(skeleton.unmodeled) == len(_KEYPOINTS) - _JOINTS
    detections = replace(simulate_detections(rig, points, rng), skeleton=skeleton)
    result = posefuse.reconstruct(rig, detections, posefuse.Options(people=people, bodies=bodies, solve="frame"))
    error_m = {name: np.sqrt(np.mean((layer.points_m[:, 0] - points) ** 2)) for name, layer in result.layers.items()}
    assert result.best_layer()[0] == "model"
    assert error_m["model"] < error_m["measured"] < 0.01


def test_measured_is_the_default_layer_if_the_model_lacks_most_keypoints(rng):
    text = f"name = 'legs'\nkeypoints = {list(_KEYPOINTS)}\nedges = {_EDGES}\n[tree]\nsize_m = 1.0\n"
    rig, points = ring(5), six_legs(120, rng)
    # Every leg drifts by itself, so that no bone can connect two legs.
    drift = np.repeat(
        np.sin(np.arange(120) / 10.0)[:, None, None] * rng.uniform(-0.5, 0.5, (_LEGS, 3)), _JOINTS, axis=1
    )
    detections = simulate_detections(rig, points + drift, rng)
    detections = replace(detections, skeleton=parse_skeleton(text, "legs.toml"))
    result = posefuse.reconstruct(rig, detections, posefuse.Options(people="many", solve="frame"))
    modeled = np.isfinite(result.layers["model"].points_m).any(axis=(0, 1, 3)).sum()
    assert modeled < len(_KEYPOINTS) // 2
    assert result.best_layer()[0] == "measured"
    assert any("has no node for" in note for note in result.provenance.notes)


def test_note_if_fewer_people_are_tracked_than_views_show():
    scene = simulate_crowd(CrowdOptions(people=2, cameras=3, duration_s=0.8, skeleton="body_20"))
    notes = {
        most: posefuse.reconstruct(
            scene.rig, scene.detections, Options(health="off", tracker=TrackerOptions(max_people=most))
        ).provenance.notes
        for most in (1, 2)
    }
    assert any(note.startswith("People tracked at a time: 1; people in a view: 2") for note in notes[1])
    assert not any(note.startswith("People tracked") for note in notes[2])
