"""Simulated views of one person that are matched, with disturbed cameras."""

from dataclasses import replace

import numpy as np
from benchmarks.clock_coverage import detect

from posefuse.calibration.people.views import MatchedViews, ViewTracks
from posefuse.model.cameras import Camera, CameraRig, rotation_from_vector
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.figures import human
from posefuse.synthetic.rigs import build_rig
from posefuse.synthetic.walkers import Attendance, stroll

SCALE_PX = 4.5 * 1.92


def walking_person(
    cameras: int = 4,
    duration_s: float = 6.0,
    rates_hz: tuple[float, ...] = (25.0,),
    offsets_s: tuple[float, ...] = (0.0,),
    seed: int = 0,
) -> tuple[MatchedViews, CameraRig]:
    """Return the views with the true cameras, at timestamps that start at 0 in each view, and the rig."""
    rng = np.random.default_rng([seed, 5])
    rig, skeleton = build_rig("ring", cameras, radius_m=5.0), find_skeleton("halpe_26")
    figure = human(1.75)
    walk = stroll((Attendance(),), 1.8, duration_s + 4.0, rng)[0]
    views = []
    for v, camera in enumerate(rig.cameras):
        rate_hz = rates_hz[v % len(rates_hz)]
        time_s = np.arange(round(duration_s * rate_hz)) / rate_hz
        true_s = time_s + offsets_s[v % len(offsets_s)]
        points = walk.positions(figure, true_s + 2.0)[:, figure.columns(skeleton)]
        pixels, sigma = detect(camera.project(points)[0][:, None], rng, rate_hz)
        views.append(ViewTracks(camera, True, time_s, pixels, SCALE_PX / sigma))
    offsets = np.resize(np.array(offsets_s), cameras)
    return MatchedViews(skeleton, tuple(views), offsets - offsets[0], np.ones(cameras), {}), rig


def disturbed(matched: MatchedViews, seed: int, focal: float = 0.0, offset_s: float = 0.0) -> MatchedViews:
    """Return the views with cameras that are wrong by up to 5 degrees and 0.4 m, and wrong clocks and focal lengths."""
    rng = np.random.default_rng([seed, 6])
    views = []
    for view in matched.views:
        matrix = np.array(view.camera.matrix)
        matrix[:2, :2] *= np.exp(focal * rng.uniform(-1.0, 1.0))
        camera = replace(_moved(view.camera, rng), matrix=matrix)
        views.append(replace(view, camera=camera, focal_known=focal == 0.0))
    shift = offset_s * rng.uniform(-1.0, 1.0, len(views))
    return replace(matched, views=tuple(views), offset_s=matched.offset_s + shift - shift[0])


def _moved(camera: Camera, rng: np.random.Generator) -> Camera:
    turn, shift = rng.standard_normal(3), rng.standard_normal(3)
    rotation = rotation_from_vector(turn * np.radians(5.0) / np.linalg.norm(turn)) @ camera.rotation
    center = camera.center_m + 0.4 * shift / np.linalg.norm(shift)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ center
    return replace(camera, camera_from_world=pose)
