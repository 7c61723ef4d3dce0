"""Call the library for :mod:`benchmarks.same_numbers` by its public names only; run with either tree.

``python -P same_numbers_library.py WHAT INPUT OUTPUT [option=value ...]``.
"""

import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

import posefuse

METHODS = ("consensus", "simple", "weighted_subsets", "percentile_filter", "ransac", "irls", "midpoint")
"""Names in the base; ``METHODS=name,...`` on the call replaces them if the current tree renames one."""


def options_of(words: dict[str, str]) -> posefuse.Options:
    """Return options from words or numbers."""
    known = {"noise_scale_px": float, "rate_hz": float}
    return posefuse.Options(**{name: known.get(name, str)(value) for name, value in words.items()})


def reconstructed(folder: Path, output: Path, words: dict[str, str]) -> None:
    """Reconstruct arrays and write the result, without a recording check."""
    rig = posefuse.read_cameras(words.pop("CALIBRATION", folder / "calibration.toml"))
    detections = posefuse.read_detections(folder / "keypoints.nc")
    posefuse.write(posefuse.reconstruct(rig, detections, options_of(words)), output / "reconstruction.nc")


def triangulated(folder: Path, output: Path, words: dict[str, str]) -> None:
    """Triangulate the same detections with every method."""
    methods = words.pop("METHODS", ",".join(METHODS)).split(",")
    rig = posefuse.read_cameras(folder / "calibration.toml")
    detections = posefuse.read_detections(folder / "keypoints.nc")
    options = options_of(words)
    for base_name, method in zip(METHODS, methods, strict=True):
        chosen = replace(options, triangulation=replace(options.triangulation, method=method))
        result = posefuse.triangulate(rig, detections, chosen)
        posefuse.write(result, output / f"{base_name}.nc")


def tracked(folder: Path, output: Path, words: dict[str, str]) -> None:
    """Track people frame by frame, and write the people of each frame."""
    skeleton = words.pop("skeleton")
    rig = posefuse.read_cameras(folder / "calibration.toml")
    held = np.load(folder / "frames.npz")
    tracker = posefuse.Tracker(rig, skeleton, options_of(words))
    views, tracked_people = range(len(rig.names)), []
    for number, time_s in enumerate(held["time_s"]):
        rows = [np.flatnonzero((held["frame"] == number) & (held["view"] == view)) for view in views]
        pixels, confidence = ([held[name][row] for row in rows] for name in ("keypoints_px", "confidence"))
        frame = posefuse.Frame.of_people(pixels, confidence, time_s=float(time_s), number=number)
        tracked_people += [(number, person) for person in tracker.update(frame).people]
    np.savez(
        output / "people.npz",
        frame=[number for number, _ in tracked_people],
        name=[str(person.name) for _, person in tracked_people],
        state=[int(person.state) for _, person in tracked_people],
        points_m=[person.points_m for _, person in tracked_people],
        covariance_m2=[person.covariance_m2 for _, person in tracked_people],
    )


CALLS = {"reconstruct": reconstructed, "triangulate": triangulated, "track": tracked}


def main() -> None:
    """Run one of the calls."""
    warnings.simplefilter("ignore")
    what, folder, output = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    output.mkdir(parents=True, exist_ok=True)
    CALLS[what](folder, output, dict(word.split("=", 1) for word in sys.argv[4:]))


if __name__ == "__main__":
    main()
