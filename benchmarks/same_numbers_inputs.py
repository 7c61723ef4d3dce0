"""Make the inputs of :mod:`benchmarks.same_numbers` that no command makes; run with the code of the base only.

``python -P same_numbers_inputs.py NAME DATA OUTPUT``, with the base's ``src`` and its root on the path. Both trees read
what is written here, so this file may use the base's own modules. It must not be run with any other tree.
"""

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from posefuse.model.skeletons import Skeleton, parse_skeleton
from posefuse.synthetic.animals import AnimalOptions, renamed, simulate_animals
from posefuse.synthetic.faults import Fault, healthy, plant

import posefuse
from benchmarks import animals, panoptic
from posefuse.cli.simulate import write_scene
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.model.detections import Detections
from posefuse.synthetic.crowd_options import CrowdFaults
from posefuse.synthetic.crowds import crowd_of_points

PANOPTIC_FRAMES = 400
OUTDOOR_POINTS = 5000
FAULTS: dict[str, tuple[tuple[Fault, tuple[int, ...]], ...]] = {
    "healthy": (),
    "turned_late": (("turned", (0,)), ("late", (2,))),
    "moved_dropped": (("moved across", (0,)), ("dropped", (2,))),
    "bumped_drift": (("bumped", (0,)), ("drift", (2,))),
    "focal_confidence": (("focal", (0,)), ("confidence", (2,))),
    "lens_sides": (("lens", (0,)), ("sides", (2,))),
    "rotated_repeated": (("rotated image", (0,)), ("repeated", (2,))),
    "resized": (("resized image", (0,)),),
    "order": (("order", (0, 1)),),
    "copied": (("copied pose", (0, 1)),),
    "another_rig": (("another rig", ()),),
}
"""Recordings with faults, for the recording check and the measurement of clocks."""


EDITS = """
[[edit]]
do = "split"
person = "person_1"
into = "later"
from_frame = 60
[[edit]]
do = "rename"
person = "person_2"
to = "second"
[[edit]]
do = "drop"
person = "person_3"
to_frame = 50
[[edit]]
do = "swap"
people = ["later", "second"]
from_frame = 80
"""


def edits(data: Path, output: Path) -> None:
    """Write edits of the result of two people."""
    (output / "edits.toml").write_text(EDITS)


def mice(data: Path, output: Path) -> None:
    """Simulate two mice in an arena, with a complete skeleton, with edges only, and with names only."""
    scene = simulate_animals(AnimalOptions("arena", 2, 5, 15.0, 30.0, seed=3, faults=CrowdFaults(miss_share=0.03)))
    for name in ("whole", "edges", "list"):
        (output / name).mkdir()
    write_scene(scene, output / "whole")
    edges = parse_skeleton(animals.OWN_TOML, "my_mouse.toml")
    (output / "my_mouse.toml").write_text(animals.OWN_TOML)
    write_scene(renamed(scene, edges, animals.OF), output / "edges")
    write_scene(renamed(scene, Skeleton("keypoints", tuple(animals.OF)), animals.OF), output / "list")


def panoptic_one(data: Path, output: Path) -> None:
    """Apply the simulated detector of crowds to the recorded motion of one person."""
    motion = panoptic.one_person(data)
    write_scene(crowd_of_points(motion.points_m[:PANOPTIC_FRAMES], motion.rig, motion.skeleton, motion.rate_hz), output)


def panoptic_three(data: Path, output: Path) -> None:
    """Apply the simulated detector of crowds to the recorded motion of three people."""
    motion = panoptic.three_people(data)
    write_scene(crowd_of_points(motion.points_m, motion.rig, motion.skeleton, motion.rate_hz), output)


def outdoor(data: Path, output: Path) -> None:
    """Write a sample of the points that four or more cameras see, and their calibration."""
    folder = data / "mouse_outdoor_12cam"
    pixels = np.load(folder / "points_right_4_10_2026_sub.npz")["p2d"]
    several = np.flatnonzero(np.isfinite(pixels).all(axis=-1).sum(axis=0) >= 4)
    chosen = np.sort(np.random.default_rng(0).choice(several, OUTDOOR_POINTS, replace=False))
    shutil.copy(folder / "calibration_right_4_10_2026_adjusted.toml", output / "calibration.toml")
    names = posefuse.read_cameras(output / "calibration.toml").names
    chosen_px = pixels[:, chosen].transpose(1, 0, 2)[:, :, None]
    points = Detections.from_dense(Skeleton("point", ("point",)), names, chosen_px, rate_hz=30.0)
    native.write(points, output / "keypoints.nc")


def wand(data: Path, output: Path) -> None:
    """Simulate a point at random places, with cameras whose calibration has wrong focal lengths."""
    rng, rig = np.random.default_rng(7), healthy(1, cameras=5).rig
    points_m = rng.uniform((-2.5, -2.5, 0.0), (2.5, 2.5, 2.4), (800, 3))
    pixels = rig.project(points_m) + rng.normal(0.0, 0.5, (800, 5, 2))
    sizes = np.array([camera.size_px for camera in rig.cameras])
    inside = ((pixels >= 0) & (pixels < sizes)).all(axis=-1, keepdims=True)
    pixels = np.where(inside, pixels, np.nan)[:, :, None]
    given = [replace(each, matrix=each.matrix * [[1.02], [1.02], [1.0]]) for each in rig.cameras]
    anipose.write(replace(rig, cameras=tuple(given)), output / "calibration.toml")
    points = Detections.from_dense(Skeleton("point", ("point",)), rig.names, pixels, rate_hz=30.0)
    native.write(points, output / "keypoints.nc")


def frames(data: Path, output: Path) -> None:
    """Write a crowd as arrays with one row per person and view, for a tracker that runs frame by frame."""
    folder = output.parent / "people"
    shutil.copy(folder / "calibration.toml", output / "calibration.toml")
    found = posefuse.read_detections(folder / "keypoints.nc")
    cells = np.repeat(np.arange(found.n_frames * found.n_views), np.diff(found.offsets))
    np.savez(
        output / "frames.npz",
        keypoints_px=np.asarray(found.keypoints_px),
        confidence=np.asarray(found.confidence),
        frame=cells // found.n_views,
        view=cells % found.n_views,
        time_s=np.asarray(found.time_s)[:, 0],
    )


def faults(data: Path, output: Path) -> None:
    """Simulate a walk with faults in some of the cameras."""
    for seed, (name, planted) in enumerate(FAULTS.items()):
        scene = healthy(seed, cameras=5, duration_s=12.0, rate_hz=30.0)
        for fault, views in planted:
            scene, _ = plant(scene, fault, views)
        rig, detections = scene.watch()
        (output / name).mkdir()
        anipose.write(rig, output / name / "calibration.toml")
        native.write(detections, output / name / "keypoints.nc")


MAKERS = {made.__name__: made for made in (edits, mice, panoptic_one, panoptic_three, outdoor, wand, frames, faults)}


def main() -> None:
    """Make one input."""
    name, data, output = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    output.mkdir(parents=True)
    MAKERS[name](data, output)


if __name__ == "__main__":
    main()
