"""Read or simulate the recordings of which :mod:`benchmarks.held_out` leaves out cameras."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.ndimage import gaussian_filter1d

import posefuse
from benchmarks import motions, real_recordings
from benchmarks.animal_scenes import AnimalOptions, simulate_animals
from benchmarks.walking import observe
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.pipeline.refine_calibration import refine_calibration
from posefuse.preprocess.match_cameras import match_views
from posefuse.skeleton.skeletons import Skeleton
from posefuse.synthetic.rigs import build_rig

FLY_RATE_HZ, MOUSE_RATE_HZ, POSE2SIM_RATE_HZ = 300.0, 30.0, 60.0
"""Frame rates that the files do not state; that of the mouse is a guess."""

OUTDOOR_REFINED, OUTDOOR_POINTS = 20_000, 2000
"""Points that refine the calibration, and those that are predicted."""

PERSON_FRAMES, SKIN_SD_M, SKIN_S = 300, 0.015, 0.15


@dataclass(frozen=True)
class Case:
    """A recording and how its subjects are found.

    Attributes:
        rig: cameras.
        detections: detections.
        people: how many subjects there are.
    """

    rig: CameraRig
    detections: Detections
    people: Literal["one", "many"] = "one"


def balancing(folder: Path) -> Case:
    """Read a person on a beam, four cameras, OpenPose."""
    rig, detections = real_recordings.pose2sim(folder)
    return Case(rig, detections.with_rate(POSE2SIM_RATE_HZ))


def two_people(folder: Path) -> Case:
    """Read two people and a bystander, four cameras, OpenPose."""
    rig = posefuse.read_cameras(folder / "pose2sim" / "calibration" / "Calib.qca.txt")
    detections = posefuse.read_detections(folder / "pose2sim" / "two_people" / "pose")
    return Case(rig, detections.with_rate(POSE2SIM_RATE_HZ), "many")


def fly(folder: Path) -> Case:
    """Read a tethered fly with two points per leg and a bone between them."""
    rig, detections = real_recordings.fly_3cam(folder)
    legs = tuple((f"{side}{leg}A", f"{side}{leg}B") for side in "LR" for leg in (1, 2, 3))
    skeleton = replace(detections.skeleton, edges=legs)
    return Case(rig, replace(detections, skeleton=skeleton).with_rate(FLY_RATE_HZ))


def mouse(folder: Path) -> Case:
    """Read a mouse, four cameras, SLEAP."""
    rig, detections = real_recordings.sleap_mouse(folder)
    return Case(rig, detections.with_rate(MOUSE_RATE_HZ))


def labeled_mouse(folder: Path) -> Case:
    """Read ten hand-labeled images of a mouse, six cameras; they are seconds apart."""
    file = folder / "dannce_mouse" / "label3d_demo.mat"
    return Case(posefuse.read_cameras(file), posefuse.read_detections(file).with_rate(MOUSE_RATE_HZ))


def outdoor(folder: Path) -> Case:
    """Read a sample of separate points seen by four or more of eleven cameras, whose poses are refined on the points.

    The recording's calibration is a first guess; its twelfth camera, "18", shows something else and is left out.
    """
    place = folder / "mouse_outdoor_12cam"
    given = posefuse.read_cameras(place / "calibration_right_4_10_2026_adjusted.toml")
    pixels = np.load(place / "points_right_4_10_2026_sub.npz")["p2d"].transpose(1, 0, 2)[:, :, None]
    names = tuple(name for name in given.names if name != "18")
    points = Detections.from_dense(Skeleton("point", ("point",)), given.names, pixels).views(names)
    pixels = points.dense()[0]
    several = np.flatnonzero(np.isfinite(pixels).all(axis=(2, 3)).sum(axis=1) >= 4)
    several = np.random.default_rng(0).permutation(several)[:OUTDOOR_REFINED]
    refined, chosen = (
        Detections.from_dense(points.skeleton, names, pixels[np.sort(several[:n])])
        for n in (OUTDOOR_REFINED, OUTDOOR_POINTS)
    )
    return Case(refine_calibration(given.select(names), refined, posefuse.Options(people="one")).rig, chosen)


def webcams(folder: Path) -> Case:
    """Read a person in front of four webcams, MediaPipe."""
    place = folder / "caliscope_webcams"
    return Case(posefuse.read_cameras(place / "config.toml"), posefuse.read_detections(place))


def simulated_mice(folder: Path, animals: int, cameras: int, seed: int = 0) -> Case:
    """Simulate mice whose keypoints slide with the skin."""
    scene = simulate_animals(AnimalOptions("arena", animals, cameras, duration_s=10.0, seed=seed))
    return Case(scene.rig, scene.detections, "many")


def simulated_person(folder: Path, cameras: int, seed: int = 0) -> Case:
    """Simulate a person whose keypoints slide with the skin, with measured errors of detections."""
    rng = np.random.default_rng(seed)
    times = 0.37 * seed + np.arange(PERSON_FRAMES) / motions.RATE_HZ
    points = motions.figure_at(times, ("walk", "turn", "reach"), seed)
    slide = gaussian_filter1d(rng.normal(size=points.shape), SKIN_S * motions.RATE_HZ, axis=0)
    points += SKIN_SD_M * slide / slide.std()
    data = motions.with_lasting_noise(observe(build_rig("ring", cameras), points, rng), seed)
    return Case(data.rig, data.detections)


def some_cameras(read: Callable[[Path], Case], names: tuple[str, ...]) -> Callable[[Path], Case]:
    """Return a reader of some of the cameras of a recording."""

    def select(folder: Path) -> Case:
        case = matched(read(folder))
        return replace(case, rig=case.rig.select(names), detections=case.detections.views(names))

    return select


def matched(case: Case) -> Case:
    """Return the cameras in the order of the views, with their names."""
    rig, detections, _ = match_views(case.rig, case.detections, posefuse.Options())
    return replace(case, rig=rig, detections=replace(detections, view_names=rig.names))


RECORDINGS: dict[str, Callable[[Path], Case]] = {
    "fly_3cam": fly,
    "sleap_mouse": mouse,
    "dannce_mouse": labeled_mouse,
    "mouse_outdoor_12cam": outdoor,
    "caliscope_webcams": webcams,
    "pose2sim/balancing_one_person": balancing,
    "pose2sim/two_people": two_people,
    "simulated mice": partial(simulated_mice, animals=2, cameras=5),
    "simulated person": partial(simulated_person, cameras=5),
    "sleap_mouse, three cameras": some_cameras(mouse, ("mid", "side", "top")),
    "caliscope_webcams, three cameras": some_cameras(webcams, ("cam_0", "cam_1", "cam_2")),
    "simulated mouse, three cameras": partial(simulated_mice, animals=1, cameras=3),
    "simulated person, three cameras": partial(simulated_person, cameras=3),
}
"""Name to reader. With three cameras, two of them predict the third."""
