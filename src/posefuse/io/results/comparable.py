"""Read results and ground truth of any format for a comparison.

Results of posefuse are taken in the calibration's coordinate system. Files of 3D points are taken as they are, except
that TRC files have y up.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from posefuse.alignment.apply import in_calibration_world
from posefuse.errors import ResultError, choices
from posefuse.evaluation.accuracy import Truth, truth_from_result, truth_from_trajectories
from posefuse.evaluation.paired_results import PeoplePoints, people_points, with_truths
from posefuse.io.files import must_exist
from posefuse.io.results import c3d_reading, netcdf
from posefuse.io.results.axes import y_up_from_world
from posefuse.io.results.open_result import result_file
from posefuse.io.results.read import holds_points, read_points
from posefuse.model.cameras import UpAxis
from posefuse.model.options.options import LengthUnit
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.stored_points import NoCameras, StoredPoints, reconstruction_of
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton, shipped_skeletons

_WITHOUT_FRAME_NUMBERS = (".trc", ".c3d")
"""Endings of files of one person that are matched with a result by order or time, not by frame number."""
_METERS_PER_UNIT: dict[LengthUnit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}


@dataclass(frozen=True)
class ComparableFile:
    """The content of a file.

    Attributes:
        path: the file.
        content: people in meters.
        was_aligned: whether it was stored in another coordinate system than the calibration's.
    """

    path: Path
    content: Reconstruction
    was_aligned: bool = False


def read_comparable(
    path: Path, length_unit: LengthUnit | None = None, skeleton: Skeleton | None = None
) -> ComparableFile:
    """Read a result of posefuse, or 3D points in any format that :func:`posefuse.read_points` reads.

    Args:
        path: folder of a result or of a run, its ``reconstruction.nc``, a ``truth.nc``, or a file of 3D points.
        length_unit: unit of length of a file that does not state it.
        skeleton: skeleton whose names of other programs are recognized; default: the shipped ones.

    Raises:
        FileError: if there is no such file, it is corrupt, or its format is not supported.
        ResultError: if its unit of length is unknown.
    """
    stored = result_file(path)
    file = stored if stored.is_file() or (path.is_dir() and not holds_points(path)) else path
    must_exist(file, "result or file of 3D points")
    if file.suffix.lower() == ".nc" and not holds_points(file):
        result = netcdf.read_reconstruction(file)
        return ComparableFile(file, in_calibration_world(result), result.alignment is not None)
    points = _in_meters(read_points(file), file, length_unit)
    bare = tuple(name.rpartition(":")[2] for name in points.keypoints)
    known = _skeleton_of(bare if len(set(bare)) == len(bare) else points.keypoints, file.stem, skeleton)
    return ComparableFile(file, reconstruction_of(points, known, _up_of(file), file.name))


def _in_meters(points: StoredPoints, file: Path, length_unit: LengthUnit | None) -> StoredPoints:
    if points.unit == "px":
        raise ResultError(f"{file} is in px (one camera's image plane) and cannot be compared in 3D.")
    if points.unit:
        return points
    if length_unit is None:
        raise ResultError(
            f"{file} does not state its unit of length. Set `length_unit` to one of: {choices(_METERS_PER_UNIT)}."
        )
    factor = _METERS_PER_UNIT[length_unit]
    scaled = None if points.covariance_m2 is None else factor**2 * points.covariance_m2
    return replace(points, points_m=factor * points.points_m, covariance_m2=scaled, sd_m=None, unit="m")


def _up_of(file: Path) -> UpAxis | None:
    if file.suffix.lower() == ".trc":
        return "y"
    return c3d_reading.read(file).up if file.suffix.lower() == ".c3d" else None


def _skeleton_of(names: tuple[str, ...], title: str, skeleton: Skeleton | None) -> Skeleton:
    """Return a skeleton with these keypoints under canonical names, with the edges of the skeleton that knows most."""
    shipped = sorted((shipped_skeleton(name) for name in shipped_skeletons()), key=len)
    candidates = shipped if skeleton is None else [skeleton, *shipped]
    # The first of those that know most names.
    found = max(candidates, key=lambda each: sum(each.canonical(name) is not None for name in names))
    if not any(found.canonical(name) for name in names):
        return Skeleton(title, names)
    renamed: list[str] = []
    for name in names:
        keypoint = found.canonical(name)
        renamed.append(keypoint if keypoint is not None and keypoint not in (*renamed, *names) else name)
    keypoints = tuple(renamed)
    if keypoints == found.keypoints:
        return found
    return Skeleton(found.name, keypoints, tuple(edge for edge in found.edges if set(edge) <= set(keypoints)))


def pair_with_truth(
    result: Reconstruction, files: Sequence[Path], length_unit: LengthUnit | None = None
) -> Truth | PeoplePoints:
    """Read ground truth and pair it with a result.

    Args:
        result: result in the calibration's coordinate system.
        files: one file with all people, or one file per person.
        length_unit: unit of length of files that do not state it.

    Returns:
        The truth of one person if both hold one, otherwise the people of both.

    Raises:
        FileError: if a file does not exist, is corrupt, or has no supported format.
        ResultError: if the files do not fit each other or the result.
    """
    truths = [_turned(read_comparable(file, length_unit, result.skeleton), result) for file in files]
    if all(truth.path.suffix.lower() in _WITHOUT_FRAME_NUMBERS for truth in truths):
        found = [_trajectories(result, truth.content) for truth in truths]
        if len(found) == len(result.person_ids) == 1:
            return found[0]
        return with_truths(result, found, [truth.path.stem for truth in truths])
    known = _joined(truths)
    if len(known.person_ids) == len(result.person_ids) == 1:
        return truth_from_result(result, known)
    return people_points(result, known)


def truth_at_frames_of(result: Reconstruction, paired: Truth | PeoplePoints) -> np.ndarray:
    """Return paired ground truth for drawing, shape (result frame, person, keypoint, 3), NaN where unknown.

    Args:
        result: the result with which the truth was paired.
        paired: what :func:`pair_with_truth` returned.
    """
    names = paired.keypoints if isinstance(paired, Truth) else paired.skeleton.keypoints
    points = paired.points_m[:, None] if isinstance(paired, Truth) else paired.truth_m
    out = np.full((result.n_frames, points.shape[1], len(result.skeleton), 3), np.nan)
    rows = slice(None)
    if isinstance(paired, PeoplePoints) and len(points) != result.n_frames:
        if paired.time_s is None:
            return out
        rows = np.searchsorted(result.time_s, paired.time_s)
    for k, name in enumerate(names):
        if name in result.skeleton.keypoints:
            out[rows, :, result.skeleton.index(name)] = points[:, :, k]
    return out


def _trajectories(result: Reconstruction, known: Reconstruction) -> Truth:
    points = np.asarray(known.best_layer()[1].points_m)[:, 0]
    return truth_from_trajectories(result, known.skeleton.keypoints, known.time_s, points)


def _turned(truth: ComparableFile, result: Reconstruction) -> ComparableFile:
    """Return the truth in the axes of a result; all files but TRC, which has y up, have the calibration's axes."""
    known, ours, theirs = truth.content, result.rig.up_axis, truth.content.rig.up_axis
    if _is_trc(result) or _is_trc(known):
        rotation = y_up_from_world(ours).T @ y_up_from_world(theirs)
        layers = {name: _rotated(layer, rotation) for name, layer in known.layers.items()}
        return replace(truth, content=replace(known, layers=layers))
    if isinstance(known.rig, NoCameras) and None not in (ours, theirs) and ours != theirs:
        raise ResultError(
            f"{truth.path} has {theirs} up, but the calibration has {ours}. Export the file in the calibration's axes."
        )
    return truth


def _is_trc(content: Reconstruction) -> bool:
    return isinstance(content.rig, NoCameras) and content.rig.source.lower().endswith(".trc")


def _rotated(layer: Layer, rotation: np.ndarray) -> Layer:
    return replace(layer, points_m=np.asarray(layer.points_m) @ rotation.T)


def _joined(truths: Sequence[ComparableFile]) -> Reconstruction:
    """Return the people of one or several files as one reconstruction, by frame number."""
    first, *others = (truth.content for truth in truths)
    if not others:
        return first
    contents = [first, *others]
    several = [truth.path.name for truth in truths if len(truth.content.person_ids) != 1]
    if several:
        raise ResultError(
            f"Specify one ground-truth file with all people, or one file per person; {choices(several)} has several."
        )
    if any(each.skeleton.keypoints != first.skeleton.keypoints for each in others):
        raise ResultError("The ground-truth files have different keypoints. Specify files with the same keypoints.")
    numbers = np.unique(np.concatenate([each.frame_numbers for each in contents]))
    points = np.full((len(numbers), len(contents), len(first.skeleton), 3), np.nan)
    time_s = np.full(len(numbers), np.nan)
    for p, each in enumerate(contents):
        rows = np.searchsorted(numbers, each.frame_numbers)
        points[rows, p], time_s[rows] = np.asarray(each.best_layer()[1].points_m[:])[:, 0], each.time_s
    names = tuple(truth.path.stem for truth in truths)
    stored = StoredPoints(first.skeleton.keypoints, names, numbers, time_s, points, "m", rate_hz=first.rate_hz)
    return reconstruction_of(stored, first.skeleton, first.rig.up_axis, first.rig.source)
