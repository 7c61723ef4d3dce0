"""Measure the distance between detections of held-out cameras and points of the other cameras.

``python -m benchmarks.held_out FOLDER [--only NAME ...] [--frames N]``, where FOLDER holds the recordings that the
tests read. Triangulation methods and the layers of ``reconstruct`` with fitted bodies, among them the default layer,
are compared over the detections that all of them predict. A view is left out of everything, also of the choice of the
default layer. All figures include the errors of the held-out camera, so they differ less than the points.

Several subjects: the result of all cameras assigns the predicted detections to subjects. The subject of a result
without the camera is the one with most of the same detections in the other views of the frame. Tracking assigns
detections in the same way for all methods and layers.
"""

import argparse
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

import posefuse
from benchmarks.held_out_recordings import RECORDINGS, Case, matched
from posefuse.evaluation.accuracy import bone_variation
from posefuse.model.detections import Detections
from posefuse.model.options.triangulation import METHODS
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.tracks import Tracks

MIN_CONFIDENCE = 0.2
NEAR_BEST = 1.01
DEFAULT = "default"
LAYERS = ("measured", "solved", "model")

Points = dict[str, tuple[np.ndarray, Tracks]]
"""Method or layer to points, shape (frame, person, keypoint, 3), and the assignment of detections to people."""

Method = Callable[[Case], Points]


@dataclass(frozen=True)
class HeldOut:
    """Predictions of one method's points for held-out cameras.

    Attributes:
        median_px, mean_px, p90_px: distance between predictions and detections, over cameras, frames and keypoints that
            all methods predict.
        predicted: share of the detections that the method predicts.
        bones: variation of bone lengths, all cameras used; NaN without bones.
    """

    median_px: float
    mean_px: float
    p90_px: float
    predicted: float
    bones: float


def triangulated(case: Case, method: str) -> Points:
    """Return the points of a triangulation method, from two views on."""
    options = posefuse.Options(
        people=case.people, bodies="none", solve="frame", health="off",
        triangulation=posefuse.TriangulationOptions(method=method, min_views=2),
    )  # fmt: skip
    return {method: layer_of(posefuse.reconstruct(case.rig, case.detections, options), "measured")}


def layers(case: Case) -> Points:
    """Return all layers of the result, with fitted bodies unless keypoints are unrelated, and the default one."""
    bodies = "fit" if case.detections.skeleton.edges else "none"
    options = posefuse.Options(people=case.people, bodies=bodies, health="off")
    result = posefuse.reconstruct(case.rig, case.detections, options)
    chosen = result.best_layer()[0]
    return {name: layer_of(result, name) for name in LAYERS if name in result.layers} | {
        DEFAULT: layer_of(result, chosen)
    }


def over_time(case: Case) -> Points:
    """Return the measured and the solved points."""
    options = posefuse.Options(people=case.people, bodies="none", solve="trajectory", health="off")
    result = posefuse.reconstruct(case.rig, case.detections, options)
    return {name: layer_of(result, name) for name in ("measured", "solved")}


def layer_of(result: Reconstruction, name: str) -> tuple[np.ndarray, Tracks]:
    """Return the points of a layer, and the assignment of detections to people."""
    assert result.tracks is not None
    return np.asarray(result.layers[name].points_m), result.tracks


EVERYTHING: tuple[Method, ...] = (
    *(partial(triangulated, method=name) for name in METHODS if name != "consensus"),
    layers,
)
"""What the table compares; ``measured`` are the points of the method ``consensus``."""


def same_people(tracks: Tracks, reference: Tracks, views: Sequence[int]) -> np.ndarray:
    """Return the person of a result who is each person of a reference, shape (frame, person), int64; -1 for none.

    Args:
        tracks: assignment in the views of the result.
        reference: assignment in all views.
        views: the result's views, as indices of the reference's.
    """
    ours, theirs = np.asarray(tracks.detection), np.asarray(reference.detection)[:, :, views]
    if not ours.shape[1]:
        return np.full(theirs.shape[:2], -1)
    equal = ((ours[:, None] == theirs[:, :, None]) & (ours[:, None] >= 0)).sum(axis=-1)
    total = equal.sum(axis=0)
    most = np.where(total.any(axis=-1), total.argmax(axis=-1), -1)
    return np.where(equal.any(axis=-1), equal.argmax(axis=-1), most)


def errors_px(case: Case, reference: Tracks, method: Method) -> dict[str, np.ndarray]:
    """Return the distances of each camera's detections from the points of the others.

    Returns:
        Shape (view, frame, person, keypoint) by method or layer, NaN without a detection or a prediction.
    """
    found: dict[str, list[np.ndarray]] = {}
    pixels = target_pixels(case.detections, reference)
    for v, name in enumerate(case.rig.names):
        others = tuple(other for other in case.rig.names if other != name)
        part = Case(case.rig.select(others), case.detections.views(others), case.people)
        views = [i for i in range(len(case.rig)) if i != v]
        for label, (points, tracks) in method(part).items():
            person = same_people(tracks, reference, views)
            if points.shape[1]:
                points = np.take_along_axis(points, np.maximum(person, 0)[..., None, None], axis=1)
                points = np.where((person >= 0)[..., None, None], points, np.nan)
            else:
                points = np.full((*person.shape, *points.shape[2:]), np.nan)
            predicted = case.rig.cameras[v].project(points)[0]
            found.setdefault(label, []).append(np.linalg.norm(predicted - pixels[:, :, v], axis=-1))
    return {label: np.stack(errors) for label, errors in found.items()}


def target_pixels(detections: Detections, reference: Tracks) -> np.ndarray:
    """Return the keypoints to predict, shape (frame, person, view, keypoint, 2), NaN where none is certain enough."""
    rows = reference.rows(detections)
    at = np.maximum(rows, 0)
    pixels, confidence = np.asarray(detections.keypoints_px)[at], np.asarray(detections.confidence)[at]
    return np.where(((rows >= 0)[..., None] & ~(confidence < MIN_CONFIDENCE))[..., None], pixels, np.nan)


def people_of(case: Case) -> Tracks:
    """Return the assignment of detections to subjects with all cameras."""
    options = posefuse.Options(people=case.people, bodies="none", solve="frame", health="off")
    tracks = posefuse.reconstruct(case.rig, case.detections, options).tracks
    assert tracks is not None
    return tracks


def compare(case: Case, methods: Sequence[Method]) -> dict[str, HeldOut]:
    """Return the results of every method and layer on a recording."""
    case = matched(case)
    reference = people_of(case)
    errors = {name: each for method in methods for name, each in errors_px(case, reference, method).items()}
    shared = np.all([np.isfinite(error) for error in errors.values()], axis=0)
    seen = np.isfinite(target_pixels(case.detections, reference)).all(axis=-1).sum()
    figures = {}
    for method in methods:
        for name, (points, _) in method(case).items():
            error = errors[name][shared]
            bones = [
                bone_variation(points[:, p], case.detections.skeleton.edge_indices) for p in range(points.shape[1])
            ]
            figures[name] = HeldOut(
                float(np.median(error)), float(np.mean(error)), float(np.percentile(error, 90)),
                float(np.isfinite(errors[name]).sum() / seen), _mean([each for each in bones if each]),
            )  # fmt: skip
    return figures


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else np.nan


def rows(name: str, figures: dict[str, HeldOut]) -> Iterator[str]:
    """Yield the rows of the table; figures of the default that are more than 1 % above the lowest are bold."""
    for method, row in figures.items():
        cells = []
        for field in ("median_px", "mean_px"):
            value = getattr(row, field)
            lost = method == DEFAULT and value > NEAR_BEST * min(getattr(each, field) for each in figures.values())
            cells.append(f"**{value:.2f}**" if lost else f"{value:.2f}")
        yield f"| `{name}` | {method} | {' | '.join(cells)} | {row.p90_px:.2f} | {100 * row.predicted:.1f} % |"


def main() -> None:
    """Print the table of docs/benchmarks.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="+", default=list(RECORDINGS), choices=list(RECORDINGS), metavar="NAME")
    parser.add_argument("--frames", type=int, help="maximum number of frames")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| recording | points | median px | mean px | 90 % px | predicted |")
    print("|---|---|---|---|---|---|")
    for name in given.only:
        case = RECORDINGS[name](given.folder)
        if given.frames:
            case = Case(case.rig, case.detections.frames(0, given.frames), case.people)
        print("\n".join(rows(name, compare(case, EVERYTHING))), flush=True)


if __name__ == "__main__":
    main()
