"""``reconstruction.nc``: all fields of a :class:`Reconstruction`, as netCDF-4 that xarray opens.

Dimensions: time, individual, keypoint, space, view, chain. The names of a layer's variables start with that of the
layer: ``measured_position`` (time, individual, keypoint, space) in meters, ``measured_covariance``,
``measured_status``, ... The attributes ``flag_values`` and ``flag_meanings`` of a variable list its codes. Options
(TOML), provenance, skeleton and alignment (JSON) are attributes of the file. The articulated fit is in ``pose_turn``
(time, individual, pose_segment, row, column), ``pose_direction`` (time, individual, pose_bone, space),
``pose_angle_sd`` (time, individual, pose_angle) in degrees, ``pose_nis`` and ``pose_nis_dof`` (time, individual), and
``pose_shape`` and ``pose_shape_sd`` (individual, pose_length). Joint angles are in ``joint_angle`` and
``joint_angle_sd`` (time, individual, joint_angle_name) in degrees, and ``joint_angle_status``. Events of tracks and
cameras are in ``event_frame``, ``event_time``, ``event_person``, ``event_what`` and ``event_why`` (event). Arrays are
rounded (``rounding.py``); the attribute ``precision`` of a variable states how.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, fields
from enum import IntEnum
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np

from posefuse.arguments import checked
from posefuse.errors import FileError
from posefuse.io.files import must_exist, reading, replacing
from posefuse.io.netcdf import (
    OutputFile,
    add_variable,
    number_of,
    open_file,
    skeleton_from_text,
    skeleton_text,
    stored_array,
    strings,
    text_of,
    write_rows,
)
from posefuse.io.options import options_to_toml, stored_options
from posefuse.io.results import netcdf_angles
from posefuse.io.results.finding_records import findings_from_json, findings_to_json
from posefuse.io.results.format import ResultFormat
from posefuse.io.results.netcdf_world import alignment_from_json, alignment_to_json, read_rig, write_rig
from posefuse.io.results.rounding import PRECISION, rounded
from posefuse.model.label_swaps import Swaps, SwapState
from posefuse.model.layer_scores import LayerScore
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import COVARIANCE_ENTRIES, LAYERS, Layer, Provenance, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.track_events import Event, Poses, current_event_kind
from posefuse.model.tracks import Tracks, TrackState

KIND = "reconstruction"
FORMAT_VERSION = 2
"""Version 2 rounds arrays (``rounding.py``); files of version 1 are not read."""

_POINT_AXES = ("time", "individual", "keypoint")
_LAYER_VARIABLES: dict[str, tuple[str, tuple[str, ...], str, type[IntEnum] | None]] = {
    "points_m": ("position", (*_POINT_AXES, "space"), "f8", None),
    "covariance_m2": ("covariance", (*_POINT_AXES, "covariance_entry"), "f4", None),
    "status": ("status", _POINT_AXES, "i1", PointStatus),
    "source": ("source", _POINT_AXES, "i1", Source),
    "reprojection_error_px": ("reprojection_error", _POINT_AXES, "f4", None),
    "view_status": ("view_status", (*_POINT_AXES, "view"), "i1", ViewStatus),
    "view_error_px": ("view_error", (*_POINT_AXES, "view"), "f4", None),
}


def write(parts: Iterable[Reconstruction], path: Path) -> None:
    """Write consecutive ranges of frames of one reconstruction, one at a time.

    Args:
        parts: at least one range; fields that do not depend on the frame come from the first one.
        path: output file; created only once all parts are written.
    """
    with replacing(path) as temporary, OutputFile(temporary) as file:
        start = 0
        events: dict[Event, None] = {}
        for part in parts:
            if start == 0:
                _write_head(file, part)
            _append(file, rounded(part), start)
            events |= dict.fromkeys(part.events)
            start += part.n_frames
            # The range must not stay in memory while the next one is computed.
            del part
        _write_events(file, tuple(events))


@checked
def read_reconstruction(path: str | Path) -> Reconstruction:
    """Open a reconstruction; layers remain in the file and are read by ranges of frames.

    Args:
        path: a ``reconstruction.nc``.

    Raises:
        FileError: if there is no such file, or it is truncated or not a reconstruction.
    """
    path = must_exist(Path(path), "reconstruction")
    with reading(path, "reconstruction"):
        return _read(path)


def _read(path: Path) -> Reconstruction:
    with open_file(path, KIND) as file:
        _check_version(path, int(number_of(file, "format_version")))
        stored = set(file.variables)
        person_ids = strings(file.variables["individual"])
        chains = strings(file.variables["chain"]) if "chain" in stored else ()
        head: dict[str, Any] = {
            "rig": read_rig(file),
            "skeleton": skeleton_from_text(text_of(file, "skeleton")),
            "person_ids": person_ids,
            "frame_numbers": np.asarray(file.variables["frame_number"][...]),
            "time_s": np.asarray(file.variables["time"][...]),
            "rate_hz": number_of(file, "rate_hz") if "rate_hz" in file.attrs else None,
            "unit": text_of(file, "unit"),
            "alignment": alignment_from_json(text_of(file, "alignment")) if "alignment" in file.attrs else None,
            "options": stored_options(json.loads(text_of(file, "options")), path.name),
            "provenance": _read_provenance(text_of(file, "provenance")),
            "findings": findings_from_json(text_of(file, "findings")) if "findings" in file.attrs else (),
        }
        if "layer_scores" in file.attrs:
            head["layer_scores"] = tuple(LayerScore(**each) for each in json.loads(text_of(file, "layer_scores")))
        if "resolved_options" in file.attrs:
            head["resolved"] = stored_options(json.loads(text_of(file, "resolved_options")), path.name)
        if "noise_scale" in stored:
            head["noise"] = NoiseModel(
                np.asarray(file.variables["noise_scale"][...]),
                number_of(file, "noise_exponent"),
                text_of(file, "noise_origin"),
                number_of(file, "noise_spread"),
                number_of(file, "noise_nu"),
            )
        head["events"] = _read_events(file)
        poses = _read_poses(file, path)
        head["joint_angles"] = netcdf_angles.read(file, path)
    layers = {
        layer: Layer(**{f.name: _stored(path, layer, f.name) for f in fields(Layer)})
        for layer in LAYERS
        if f"{layer}_position" in stored
    }
    tracks = None
    if "track_state" in stored:
        tracks = Tracks(person_ids, stored_array(path, "track_detection"), stored_array(path, "track_state"))
    swaps = Swaps(chains, stored_array(path, "chain_swapped")) if chains else None
    return Reconstruction(layers=layers, tracks=tracks, swaps=swaps, poses=poses, **head)


def _stored(path: Path, layer: str, attribute: str) -> np.ndarray:
    """Return an array of a layer, read when it is used; points, covariances and mean errors as float64."""
    name, _, kind, _ = _LAYER_VARIABLES[attribute]
    is_number = kind.startswith("f") and attribute != "view_error_px"
    return stored_array(path, f"{layer}_{name}", np.float64 if is_number else None)


def _check_version(path: Path, version: int) -> None:
    """Refuse files of other versions.

    Raises:
        FileError: if the version is another one.
    """
    if version != FORMAT_VERSION:
        remedy = "Update posefuse." if version > FORMAT_VERSION else "Reconstruct the recording again."
        raise FileError(
            f"{path} has format version {version}; this version of posefuse reads version {FORMAT_VERSION}. {remedy}"
        )


def _write_head(file: OutputFile, first: Reconstruction) -> None:
    _write_attributes(file, first)
    file.add_dimensions(
        {
            "time": None,
            "individual": len(first.person_ids),
            "keypoint": len(first.skeleton),
            "space": 3,
            "view": len(first.rig),
            "covariance_entry": 6,
            "row": 3,
            "column": 3,
            "pose_row": 4,
            "pose_column": 4,
            "coefficient": 8,
            "image_axis": 2,
        }
    )
    add_variable(file, "time", ("time",), dtype="f8", units="s")
    add_variable(file, "frame_number", ("time",), dtype="i8")
    add_variable(file, "individual", ("individual",), np.array(first.person_ids))
    add_variable(file, "keypoint", ("keypoint",), np.array(first.skeleton.keypoints))
    add_variable(file, "space", ("space",), np.array(["x", "y", "z"]))
    add_variable(file, "covariance_entry", ("covariance_entry",), np.array(COVARIANCE_ENTRIES))
    # Before the variables over the cameras: a dimension that is in use would be replaced by its variable.
    write_rig(file, first.rig)
    if not first.options.sync.does_nothing:
        add_variable(file, "retimed", ("time", "view"), dtype="i1")
    for layer in first.layers:
        for name, axes, kind, codes in _LAYER_VARIABLES.values():
            add_variable(file, f"{layer}_{name}", axes, dtype=kind, **_attributes(name, first.unit, codes))
    if first.tracks is not None:
        add_variable(file, "track_detection", ("time", "individual", "view"), dtype="i4")
        add_variable(file, "track_state", ("time", "individual"), dtype="i1", **_attributes("", "", TrackState))
    if first.swaps is not None:
        file.add_dimensions({"chain": len(first.swaps.chains)})
        add_variable(file, "chain", ("chain",), np.array(first.swaps.chains))
        axes = ("time", "individual", "view", "chain")
        add_variable(file, "chain_swapped", axes, dtype="i1", **_attributes("", "", SwapState))
    if first.poses is not None:
        _create_pose_variables(file, first.poses)
    if first.joint_angles is not None:
        netcdf_angles.create(file, first.joint_angles)
    if first.noise is not None:
        _write_noise(file, first.noise)


def _write_attributes(file: OutputFile, first: Reconstruction) -> None:
    file.attrs["posefuse_kind"] = KIND
    file.attrs["format_version"] = FORMAT_VERSION
    file.attrs["unit"] = first.unit
    file.attrs["skeleton"] = skeleton_text(first.skeleton)
    file.attrs["options"] = json.dumps(asdict(first.options))
    file.attrs["options_toml"] = options_to_toml(first.options)
    file.attrs["resolved_options"] = json.dumps(asdict(first.resolved))
    file.attrs["findings"] = findings_to_json(first.findings)
    file.attrs["provenance"] = json.dumps(asdict(first.provenance))
    if first.layer_scores:
        file.attrs["layer_scores"] = json.dumps([asdict(each) for each in first.layer_scores])
    if first.rate_hz is not None:
        file.attrs["rate_hz"] = float(first.rate_hz)
    if first.alignment is not None:
        file.attrs["alignment"] = alignment_to_json(first.alignment)


def _write_noise(file: OutputFile, noise: NoiseModel) -> None:
    file.attrs["noise_exponent"] = float(noise.exponent)
    file.attrs["noise_origin"] = noise.origin
    file.attrs["noise_spread"] = float(noise.spread)
    file.attrs["noise_nu"] = float(noise.nu)
    add_variable(file, "noise_scale", ("view",), noise.scale_px, units="px")


def _attributes(name: str, unit: str, codes: type[IntEnum] | None) -> dict[str, Any]:
    if codes is not None:
        return {
            "flag_values": np.array([code.value for code in codes], dtype=np.int8),
            "flag_meanings": " ".join(code.name.lower() for code in codes),
        }
    return {"units": {"position": unit, "covariance": f"{unit}2"}.get(name, "px"), "precision": PRECISION[name]}


def _append(file: OutputFile, part: Reconstruction, start: int) -> None:
    stop = start + part.n_frames
    file.resize_dimension("time", stop)
    write_rows(file, "time", start, part.time_s)
    write_rows(file, "frame_number", start, part.frame_numbers)
    if "retimed" in file.variables:
        write_rows(file, "retimed", start, part.retimed)
    for layer_name, layer in part.layers.items():
        for attribute, (name, *_) in _LAYER_VARIABLES.items():
            write_rows(file, f"{layer_name}_{name}", start, getattr(layer, attribute)[:])
    if part.tracks is not None:
        write_rows(file, "track_detection", start, part.tracks.detection[:])
        write_rows(file, "track_state", start, part.tracks.state[:])
    if part.swaps is not None:
        write_rows(file, "chain_swapped", start, part.swaps.state[:])
    if part.poses is not None:
        write_rows(file, "pose_turn", start, part.poses.turns[:])
        write_rows(file, "pose_direction", start, part.poses.directions[:])
        write_rows(file, "pose_angle_sd", start, part.poses.angle_sd_deg[:])
        write_rows(file, "pose_root_turn", start, part.poses.root_turn_rad2[:])
        write_rows(file, "pose_nis", start, part.poses.nis[:])
        write_rows(file, "pose_nis_dof", start, part.poses.nis_dof[:])
    if part.joint_angles is not None:
        netcdf_angles.append(file, part.joint_angles, start)


def _create_pose_variables(file: OutputFile, poses: Poses) -> None:
    """Create the variables of articulated poses, and write the segment lengths."""
    dimensions = {"segment": poses.segments, "bone": poses.bones, "length": poses.shape_names, "angle": poses.angles}
    for axis, names in dimensions.items():
        file.add_dimensions({f"pose_{axis}": len(names)})
        add_variable(file, f"pose_{axis}", (f"pose_{axis}",), np.array(names, dtype=object))
    add_variable(file, "pose_turn", ("time", "individual", "pose_segment", "row", "column"), dtype="f8", units="1")
    add_variable(file, "pose_direction", ("time", "individual", "pose_bone", "space"), dtype="f8", units="1")
    add_variable(file, "pose_angle_sd", ("time", "individual", "pose_angle"), dtype="f4", units="degree")
    add_variable(file, "pose_root_turn", ("time", "individual", "covariance_entry"), dtype="f4", units="radian2")
    add_variable(file, "pose_nis", ("time", "individual"), dtype="f8", units="1")
    add_variable(file, "pose_nis_dof", ("time", "individual"), dtype="i4", units="1")
    for name, values in (("pose_shape", poses.shape_m), ("pose_shape_sd", poses.shape_sd_m)):
        add_variable(file, name, ("individual", "pose_length"), np.asarray(values[:], dtype=np.float64), units="m")


def _read_poses(file: h5netcdf.File, path: Path) -> Poses | None:
    if "pose_turn" not in file.variables:
        return None
    segments, bones, lengths = (strings(file.variables[f"pose_{axis}"]) for axis in ("segment", "bone", "length"))
    shape_m, shape_sd_m = (np.asarray(file.variables[name][...]) for name in ("pose_shape", "pose_shape_sd"))
    turns, directions = stored_array(path, "pose_turn"), stored_array(path, "pose_direction")
    angles: tuple[str, ...] = ()
    sds = np.empty((*turns.shape[:2], 0))
    root = np.full((*turns.shape[:2], 6), np.nan)
    nis = np.full(turns.shape[:2], np.nan)
    dof = np.zeros(turns.shape[:2], dtype=np.int32)
    if "pose_angle_sd" in file.variables:
        angles, sds = strings(file.variables["pose_angle"]), stored_array(path, "pose_angle_sd", np.float64)
    if "pose_root_turn" in file.variables:
        root = stored_array(path, "pose_root_turn", np.float64)
    if "pose_nis" in file.variables:
        nis, dof = stored_array(path, "pose_nis"), stored_array(path, "pose_nis_dof")
    return Poses(segments, bones, lengths, angles, turns, directions, sds, root, nis, dof, shape_m, shape_sd_m)


def _write_events(file: OutputFile, events: tuple[Event, ...]) -> None:
    if not events:
        return
    file.add_dimensions({"event": len(events)})
    add_variable(file, "event_frame", ("event",), np.array([event.number for event in events], dtype=np.int64))
    add_variable(file, "event_time", ("event",), np.array([event.time_s for event in events]), units="s")
    for name in ("person", "what", "why"):
        add_variable(file, f"event_{name}", ("event",), np.array([getattr(e, name) for e in events], dtype=object))


def _read_events(file: h5netcdf.File) -> tuple[Event, ...]:
    if "event_frame" not in file.variables:
        return ()
    numbers, times = (np.asarray(file.variables[f"event_{name}"][...]).tolist() for name in ("frame", "time"))
    people, kinds, reasons = (strings(file.variables[f"event_{name}"]) for name in ("person", "what", "why"))
    kinds = [current_event_kind(kind) for kind in kinds]
    return tuple(
        Event(*values)  # type: ignore[arg-type]
        for values in zip(numbers, times, people, kinds, reasons, strict=True)
    )


def _read_provenance(text: str) -> Provenance:
    data = json.loads(text)
    return Provenance(data["versions"], data["inputs"], tuple(data["notes"]))


def _write_result(result: Reconstruction, people: Sequence[str], path: Path, layer: LayerName) -> list[str]:
    write(result.chunks(), path)
    return []


FORMAT = ResultFormat(
    name="netcdf",
    files="reconstruction.nc",
    conventions="netCDF-4; meters, world axes; every layer and field; rounded far below the uncertainty",
    holds_stills=True,
    endings=(".nc",),
    holds_every_layer=True,
    read_result=read_reconstruction,
    write_result=_write_result,
)
