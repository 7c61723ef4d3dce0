"""Measure the distance between detections of held-out cameras and points of the other cameras in real recordings.

``python -m benchmarks.held_out FOLDER [--only NAME,...]``, where FOLDER holds the recordings that the tests read. The
triangulation methods, the layers of ``reconstruct`` with a fitted body and the layer that is the default without the
camera are compared over the observations that all of them predict, and by the variation of bone lengths with all
cameras. All figures include the errors of the held-out camera, so they differ less than the points.
"""

import argparse
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

import posefuse
from benchmarks import real_recordings
from benchmarks.trajectory import per_frame, solved
from posefuse.evaluation.accuracy import bone_variation
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import LAYERS, Layer
from posefuse.preprocess.match_cameras import match_views

MIN_CONFIDENCE = 0.2
FLY_RATE_HZ, MOUSE_RATE_HZ, POSE2SIM_RATE_HZ = 300.0, 30.0, 60.0
"""Frame rates that the files do not state; that of the mouse is a guess."""

Method = Callable[[CameraRig, Detections], Layer]
METHODS: dict[str, Method] = {"consensus": per_frame, "trajectory": solved}


def layer_of(rig: CameraRig, detections: Detections, layer: LayerName | None) -> Layer:
    """Return a layer of the result with a fitted body, or the default one."""
    options = posefuse.Options(people="one", bodies="fit", solve="trajectory", health="off")
    return posefuse.reconstruct(rig, detections, options).best_layer(layer)[1]


def triangulated(rig: CameraRig, detections: Detections, method: str) -> Layer:
    """Return the points of a triangulation method."""
    options = posefuse.Options(triangulation=posefuse.TriangulationOptions(method=method))
    return posefuse.triangulate(rig, detections, options).layers["measured"]


EVERYTHING: dict[str, Method] = {
    **{name: partial(triangulated, method=name) for name in ("simple", "irls", "ransac")},
    **{name: partial(layer_of, layer=name) for name in LAYERS},
    "default": partial(layer_of, layer=None),
}
"""What the table compares."""


@dataclass(frozen=True)
class HeldOut:
    """Predictions of one method's points for held-out cameras.

    Attributes:
        median_px, p90_px: distance between predictions and detections, over cameras, frames and keypoints that both
            methods predict.
        mean_px: mean of the same distances.
        predicted: share of the detections that the method predicts.
        bones: variation of bone lengths, all cameras used; NaN without bones.
        missing: share of points missing, all cameras used.
    """

    median_px: float
    mean_px: float
    p90_px: float
    predicted: float
    bones: float
    missing: float


def balancing(folder: Path) -> tuple[CameraRig, Detections]:
    """Read a person on a beam, four cameras, OpenPose."""
    rig, detections = real_recordings.pose2sim(folder)
    return rig, detections.with_rate(POSE2SIM_RATE_HZ)


def fly(folder: Path) -> tuple[CameraRig, Detections]:
    """Read a tethered fly with two points per leg and a bone between them."""
    rig, detections = real_recordings.fly_3cam(folder)
    legs = tuple((f"{side}{leg}A", f"{side}{leg}B") for side in "LR" for leg in (1, 2, 3))
    skeleton = replace(detections.skeleton, edges=legs)
    return rig, replace(detections, skeleton=skeleton).with_rate(FLY_RATE_HZ)


def mouse(folder: Path) -> tuple[CameraRig, Detections]:
    """Read a mouse, four cameras, SLEAP."""
    rig, detections = real_recordings.sleap_mouse(folder)
    return rig, detections.with_rate(MOUSE_RATE_HZ)


def webcams(folder: Path) -> tuple[CameraRig, Detections]:
    """Read a person in front of four webcams, MediaPipe."""
    place = folder / "caliscope_webcams"
    return posefuse.read_cameras(place / "config.toml"), posefuse.read_detections(place)


RECORDINGS: dict[str, Callable[[Path], tuple[CameraRig, Detections]]] = {
    "fly_3cam": fly,
    "sleap_mouse": mouse,
    "caliscope_webcams": webcams,
    "pose2sim/balancing_one_person": balancing,
}


def matched(rig: CameraRig, detections: Detections) -> tuple[CameraRig, Detections]:
    """Return the cameras in the order of the views, with their names."""
    rig, detections, _ = match_views(rig, detections, posefuse.Options())
    return rig, replace(detections, view_names=rig.names)


def errors_px(rig: CameraRig, detections: Detections, method: Method) -> np.ndarray:
    """Return the distances of each camera's detections from the points of the others, shape (view, frame, keypoint).

    NaN without a detection or a prediction.
    """
    pixels, confidence = detections.dense()
    pixels = np.where((confidence >= MIN_CONFIDENCE)[..., None] | np.isnan(confidence)[..., None], pixels, np.nan)
    found = np.empty((len(rig), detections.n_frames, len(detections.skeleton)))
    for v, name in enumerate(rig.names):
        others = tuple(other for other in rig.names if other != name)
        layer = method(rig.select(others), detections.views(others))
        predicted = rig.cameras[v].project(np.asarray(layer.points_m)[:, 0])[0]
        found[v] = np.linalg.norm(predicted - pixels[:, v], axis=-1)
    return found


def compare(rig: CameraRig, detections: Detections, methods: dict[str, Method] | None = None) -> dict[str, HeldOut]:
    """Return the results of every method on a recording."""
    rig, detections = matched(rig, detections)
    methods = methods or METHODS
    errors = {name: errors_px(rig, detections, method) for name, method in methods.items()}
    shared = np.all([np.isfinite(error) for error in errors.values()], axis=0)
    seen = np.asarray(np.isfinite(detections.dense()[0]).all(axis=-1))
    figures = {}
    for name, method in methods.items():
        points = np.asarray(method(rig, detections).points_m)[:, 0]
        figures[name] = HeldOut(
            float(np.median(errors[name][shared])),
            float(np.mean(errors[name][shared])),
            float(np.percentile(errors[name][shared], 90)),
            float(np.isfinite(errors[name]).sum() / seen.sum()),
            bone_variation(points, detections.skeleton.edge_indices) or np.nan,
            float(np.isnan(points[..., 0]).mean()),
        )
    return figures


def main() -> None:
    """Print the table of docs/benchmarks.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default=",".join(RECORDINGS), help=f"some of {', '.join(RECORDINGS)}")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| recording | method | median px | mean px | 90 % px | predicted | bone variation | missing |")
    print("|---|---|---|---|---|---|---|---|")
    for name in given.only.split(","):
        for method, row in compare(*RECORDINGS[name](given.folder), EVERYTHING).items():
            print(
                f"| `{name}` | {method} | {row.median_px:.2f} | {row.mean_px:.2f} | {row.p90_px:.2f} | "
                f"{100 * row.predicted:.1f} % | "
                f"{100 * row.bones:.2f} % | {100 * row.missing:.2f} % |",
                flush=True,
            )


if __name__ == "__main__":
    main()
