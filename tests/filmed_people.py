"""Simulated people in views with their own clocks."""

from dataclasses import replace
from itertools import combinations

import numpy as np

from posefuse.calibration.people.views import MatchedViews, PeopleViews, ViewTracks
from posefuse.model.cameras import CameraRig
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import Activity, HumanMotion


def filmed_person(
    rig: CameraRig,
    rng: np.random.Generator,
    *,
    duration_s: float = 8.0,
    offsets_s: tuple[float, ...] = (),
    rates_hz: tuple[float, ...] = (),
    sigma_px: float = 4.0,
    activities: tuple[Activity, ...] = ("walk", "turn", "reach"),
    motion: HumanMotion | None = None,
) -> PeopleViews:
    """Return what cameras detect of a moving person; a view's timestamp plus its offset is the true time."""
    skeleton = find_skeleton("body_25b")
    figure = human(1.75)
    motion = motion or HumanMotion.random(activities, rng)
    views = []
    for v, camera in enumerate(rig.cameras):
        rate_hz = rates_hz[v] if rates_hz else 30.0
        time_s = np.arange(round(duration_s * rate_hz)) / rate_hz
        true_s = time_s + 3.0 + (offsets_s[v] if offsets_s else 0.0)
        points = motion.positions(figure, true_s)[:, figure.columns(skeleton)]
        pixels = camera.project(points)[0] + sigma_px * rng.standard_normal((*points.shape[:2], 2))
        unposed = replace(camera, camera_from_world=np.eye(4))
        views.append(ViewTracks(unposed, True, time_s, pixels[:, None], np.ones((len(time_s), 1, len(skeleton)))))
    return PeopleViews(skeleton, tuple(views))


def relative_rotation(rig: CameraRig, a: int, b: int) -> np.ndarray:
    """Return the rotation of camera b from camera a."""
    return rig.cameras[b].rotation @ rig.cameras[a].rotation.T


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    """Return the angle between two rotations."""
    return float(np.degrees(np.arccos(np.clip(0.5 * (np.trace(a @ b.T) - 1.0), -1.0, 1.0))))


def pose_errors(rig: CameraRig, matched: MatchedViews) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the errors of relative rotations in degrees and of centers in m, and the relative scale.

    Centers are compared after the similarity transform that fits them best.
    """
    found = [view.camera for view in matched.views]
    true = [rig[camera.name] for camera in found]
    rotations = [
        angle_deg(found[b].rotation @ found[a].rotation.T, true[b].rotation @ true[a].rotation.T)
        for a, b in combinations(range(len(found)), 2)
    ]
    centers = np.array([camera.center_m for camera in found])
    expected = np.array([camera.center_m for camera in true])
    moved, target = centers - centers.mean(axis=0), expected - expected.mean(axis=0)
    left, values, right = np.linalg.svd(target.T @ moved)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    scale = float((values * signs).sum() / (moved**2).sum())
    errors = np.linalg.norm(target - scale * moved @ (left @ np.diag(signs) @ right).T, axis=1)
    return np.array(rotations), errors, 1.0 / scale
