"""OpenSim: a folder with a TRC of OpenSim's marker set and setup files for scaling and inverse kinematics per person.

Marker names are those of Pose2Sim and OpenPose (``RKnee``, ``LBigToe``). ``markers.xml`` attaches the markers to the
bodies of the full-body model that comes with OpenSim (Rajagopal et al. 2016, ``Rajagopal2016.osim``; not part of
posefuse), at its joint centers, rounded to the mm; toes and heels are at the tips of its foot. The model is scaled by
the distances between markers over the longest interval in which all markers are present. Inverse kinematics covers the
frames from the first to the last in which the person is present.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from posefuse.arrays import ranges
from posefuse.errors import ResultError, choices
from posefuse.io.files import replacing_folder
from posefuse.io.opensim.documents import add, add_objects, document, write_document
from posefuse.io.results import trc
from posefuse.io.results.format import ResultFacts, ResultFormat
from posefuse.io.results.names import safe_names
from posefuse.io.results.opensim_model import MARKERS, MEASUREMENTS, NAMES, Measurement
from posefuse.io.results.timing import export_rate, regular_rows
from posefuse.model.detections import CHUNK_FRAMES
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.progress import Progress
from posefuse.skeleton.skeletons import Skeleton

MARKER_FILE = "markers.xml"
MODEL = "Rajagopal2016.osim"
_REQUIRED = ("RHip", "LHip", "RKnee", "LKnee")
_ACCURACY = 1e-5


def _markers(skeleton: Skeleton) -> list[str]:
    """Return the markers of the model that a skeleton has."""
    return [name for name in MARKERS if name in marker_names(skeleton).values()]


def require(facts: ResultFacts) -> None:
    """Refuse results that do not fit the model.

    Raises:
        ResultError: if the points are not in meters, the keypoints are not those of a human, or the frame rate is
            unknown or not constant.
    """
    facts.require_meters("opensim")
    markers = _markers(facts.skeleton)
    if not set(_REQUIRED) <= set(markers):
        raise ResultError(
            f"opensim: the full-body model needs the markers {choices(_REQUIRED)}; skeleton {facts.skeleton.name!r} "
            f"has {choices(markers)}."
        )
    export_rate(facts, "TRC")


def write(
    result: Reconstruction, people: Sequence[str], folder: Path, layer: LayerName, progress: Progress | None = None
) -> list[str]:
    """Write the TRC and setup files of each person, and the marker set.

    Returns:
        Notes on what the files do not contain, in sentences.

    Raises:
        ResultError: if the keypoints are not those of a human, the result contains no people, or the frame rate is
            unknown or not constant.
        FileError: if the folder holds other files.
    """
    require(ResultFacts.of(result))
    names = marker_names(result.skeleton)
    markers = _markers(result.skeleton)
    if not people:
        raise ResultError("This result contains no people: there is nothing to write for OpenSim.")
    notes = []
    owned = (MARKER_FILE, "*.trc", "*_scaling.xml", "*_ik.xml")
    with replacing_folder(folder, MARKER_FILE, owned) as staging:
        write_document(_marker_set(markers), staging / MARKER_FILE)
        for person, stem in zip(people, safe_names(people), strict=True):
            notes += _write_person(result, person, staging / stem, layer, names, markers, progress)
    unmapped = [name for name in result.skeleton.keypoints if names[name] not in MARKERS]
    if unmapped:
        notes.append(f"opensim: the model has no marker for {choices(unmapped, 6)}; they are in the TRC only.")
    if result.rig.up_axis is None:
        notes.append(
            "opensim: the up axis is unknown (`up`); OpenSim assumes that y is up and that gravity acts along -y."
        )
    return notes


def marker_names(skeleton: Skeleton) -> dict[str, str]:
    """Return OpenSim's marker names of a skeleton's keypoints; keypoints without a marker keep their names.

    If several keypoints correspond to one marker, only the first gets its name.
    """
    out: dict[str, str] = {}
    for name in skeleton.keypoints:
        marker = NAMES.get(name, name)
        out[name] = name if marker in out.values() else marker
    return out


def _write_person(
    result: Reconstruction,
    person: str,
    stem: Path,
    layer: LayerName,
    names: dict[str, str],
    markers: list[str],
    progress: Progress | None,
) -> list[str]:
    """Write the files of one person and return notes."""
    present, complete = _presence(result, person, layer, [k for k, name in names.items() if name in markers])
    if not present.any():
        return [f"opensim: {person} has no points in any frame; no files are written for {person}."]
    rate = export_rate(result, "TRC")
    renamed = replace(result.skeleton, **_renamed(result.skeleton, names))
    bare = replace(result, skeleton=renamed, layers={layer: result.layers[layer]}, tracks=None, swaps=None, poses=None)
    trc.write(bare, person, stem.with_name(f"{stem.name}.trc"), layer, progress)
    seconds = _row_times(result, rate)
    first, last = _longest_interval(complete) if complete.any() else _span(present)
    subject = result.options.subject
    scaling = _scaling(stem.name, markers, (seconds[first], seconds[last]), subject.mass_kg)
    write_document(scaling, stem.with_name(f"{stem.name}_scaling.xml"))
    first, last = _span(present)
    write_document(
        _inverse_kinematics(stem.name, markers, (seconds[first], seconds[last])), stem.with_name(f"{stem.name}_ik.xml")
    )
    notes = []
    if not complete.any():
        notes.append(
            f"opensim: {person} never has all markers in one frame; scaling uses the frames that have some of them."
        )
    if subject.mass_kg is None:
        notes.append(
            f"opensim: the mass of {person} is unknown (`subject.mass_kg`); scaling keeps the mass of the model."
        )
    return notes


def _renamed(skeleton: Skeleton, names: dict[str, str]) -> dict[str, object]:
    """Return the fields of a skeleton with renamed keypoints; other fields, which a TRC does not contain, are empty."""
    return {
        "keypoints": tuple(names[name] for name in skeleton.keypoints), "edges": (), "pairs": (), "chains": {},
        "derived": {}, "plausible_m": (), "names": {}, "core": (), "tree": None, "parts": (),
        "rigid": (),
    }  # fmt: skip


def _presence(
    result: Reconstruction, person: str, layer: LayerName, keypoints: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return in which frames some, and in which all of the points are present, each of shape (frame,), bool."""
    places = [result.skeleton.index(name) for name in keypoints]
    points, p = result.layers[layer].points_m, result.person_ids.index(person)
    finite = [
        np.isfinite(np.asarray(points[start:stop])[:, p][:, places]).all(axis=-1)
        for start, stop in ranges(result.n_frames, CHUNK_FRAMES)
    ]
    table = np.concatenate([np.zeros((0, len(places)), dtype=bool), *finite])
    number = np.count_nonzero(table, axis=1)
    return number > 0, number == len(places)


def _row_times(result: Reconstruction, rate: float) -> np.ndarray:
    """Return the times of the frames in the TRC, shape (frame,)."""
    start = result.time_s[0] if np.isfinite(result.time_s[0]) else result.frame_numbers[0] / rate
    return start + regular_rows(result)[0] / rate


def _span(present: np.ndarray) -> tuple[int, int]:
    frames = np.flatnonzero(present)
    return int(frames[0]), int(frames[-1])


def _longest_interval(present: np.ndarray) -> tuple[int, int]:
    """Return the first and last frame of the longest interval."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], present, [False]]).astype(int)))
    best = int(np.argmax(edges[1::2] - edges[::2]))
    return int(edges[2 * best]), int(edges[2 * best + 1]) - 1


def _marker_set(markers: list[str]) -> ElementTree.Element:
    root = document()
    objects = add_objects(root, "MarkerSet", name="markerset")
    for name in markers:
        body, place = MARKERS[name].body, MARKERS[name].place_m
        marker = add(objects, "Marker", name=name)
        add(marker, "socket_parent_frame", f"/bodyset/{body}")
        add(marker, "location", " ".join(f"{value:g}" for value in place))
        add(marker, "fixed", "true")
    return root


def _times(span: tuple[float, float]) -> str:
    return f"{span[0]:.6f} {span[1]:.6f}"


def _scaling(person: str, markers: list[str], span: tuple[float, float], mass_kg: float | None) -> ElementTree.Element:
    """Return the setup of OpenSim's scale tool."""
    root = document()
    tool = add(root, "ScaleTool", name=person)
    add(tool, "mass", f"{-1.0 if mass_kg is None else mass_kg:g}")
    maker = add(tool, "GenericModelMaker")
    add(maker, "model_file", MODEL)
    add(maker, "marker_set_file", MARKER_FILE)
    scaler = add(tool, "ModelScaler")
    add(scaler, "apply", "true")
    add(scaler, "scaling_order", "measurements")
    objects = add_objects(scaler, "MeasurementSet")
    for measurement in MEASUREMENTS:
        pairs = [pair for pair in measurement.pairs if pair[0] in markers and pair[1] in markers]
        if pairs:
            _add_measurement(objects, measurement, pairs)
    add(scaler, "marker_file", f"{person}.trc")
    add(scaler, "time_range", _times(span))
    add(scaler, "preserve_mass_distribution", "true")
    add(scaler, "output_model_file", f"{person}_scaled.osim")
    # No MarkerPlacer: keypoints are joint centers, and moving them to their positions in one frame adds its errors.
    return root


def _add_measurement(objects: ElementTree.Element, measurement: Measurement, pairs: list[tuple[str, str]]) -> None:
    entry = add(objects, "Measurement", name=measurement.name)
    add(entry, "apply", "true")
    markers = add_objects(entry, "MarkerPairSet")
    for first, second in pairs:
        add(add(markers, "MarkerPair", name=f"{first}-{second}"), "markers", f"{first} {second}")
    bodies = add_objects(entry, "BodyScaleSet")
    for body in measurement.bodies:
        add(add(bodies, "BodyScale", name=body), "axes", measurement.axes)


def _inverse_kinematics(person: str, markers: list[str], span: tuple[float, float]) -> ElementTree.Element:
    """Return the setup of OpenSim's inverse kinematics tool."""
    root = document()
    tool = add(root, "InverseKinematicsTool", name=person)
    add(tool, "model_file", f"{person}_scaled.osim")
    add(tool, "constraint_weight", "Inf")
    add(tool, "accuracy", f"{_ACCURACY:g}")
    objects = add_objects(tool, "IKTaskSet")
    for name in markers:
        task = add(objects, "IKMarkerTask", name=name)
        add(task, "apply", "true")
        add(task, "weight", f"{MARKERS[name].weight:g}")
    add(tool, "marker_file", f"{person}.trc")
    add(tool, "time_range", _times(span))
    add(tool, "report_errors", "true")
    add(tool, "output_motion_file", f"{person}_ik.mot")
    return root


FORMAT = ResultFormat(
    name="opensim",
    files="a folder: <person>.trc, <person>_scaling.xml, <person>_ik.xml, markers.xml",
    conventions="meters, y up; OpenSim's marker names on the bodies of Rajagopal's model",
    require=require,
    additional_name="opensim",
    is_folder=True,
    write_result=write,
)
