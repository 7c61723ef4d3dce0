"""The world of a netCDF result: cameras, up axis and alignment."""

import json
from dataclasses import asdict
from typing import Any

import h5netcdf
import numpy as np

from posefuse.io.netcdf import OutputFile, add_variable, number_of, strings, text_of
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.model.up_axis import InferredUp


def write_rig(file: OutputFile, rig: CameraRig) -> None:
    """Write the cameras and the up axis of a result."""
    if rig.up_axis is not None:
        file.attrs["up_axis"] = rig.up_axis
    if rig.up is not None:
        file.attrs["up_axis_source"] = "calibration" if rig.inferred_up is None else "inferred"
    if rig.inferred_up is not None:
        file.attrs["inferred_up"] = json.dumps(asdict(rig.inferred_up))
    file.attrs["rig_source"] = rig.source
    file.attrs["rig_meters_per_unit"] = float(rig.meters_per_unit)
    file.attrs["rig_notes"] = json.dumps(rig.notes)
    if not rig.calibrated:
        file.attrs["rig_calibrated"] = 0
    coefficients = np.full((len(rig), 8), np.nan)
    for i, camera in enumerate(rig.cameras):
        coefficients[i, : len(camera.distortion)] = camera.distortion
    add_variable(file, "view", ("view",), np.array(rig.names))
    add_variable(file, "camera_size", ("view", "image_axis"), np.array([c.size_px for c in rig.cameras]), units="px")
    add_variable(
        file, "camera_matrix", ("view", "row", "column"), np.stack([c.matrix for c in rig.cameras]), units="px"
    )
    add_variable(
        file,
        "camera_from_world",
        ("view", "pose_row", "pose_column"),
        np.stack([c.camera_from_world for c in rig.cameras]),
        units="m",
    )
    add_variable(file, "camera_lens", ("view",), np.array([str(c.lens) for c in rig.cameras]))
    add_variable(file, "camera_distortion", ("view", "coefficient"), coefficients)


def read_rig(file: h5netcdf.File) -> CameraRig:
    """Return the cameras and the up axis of a result."""

    def values(name: str) -> np.ndarray:
        return np.asarray(file.variables[name][...])

    lenses = [LensModel(lens) for lens in strings(file.variables["camera_lens"])]
    cameras = tuple(
        Camera(name, (int(size[0]), int(size[1])), matrix, pose, lens, tuple(k[np.isfinite(k)]))
        for name, size, matrix, pose, lens, k in zip(
            strings(file.variables["view"]),
            values("camera_size"),
            values("camera_matrix"),
            values("camera_from_world"),
            lenses,
            values("camera_distortion"),
            strict=True,
        )
    )
    up = file.attrs.get("up_axis")
    return CameraRig(
        cameras,
        None if up is None else str(up),  # type: ignore[arg-type]
        text_of(file, "rig_source"),
        # Files of earlier versions have the British spelling.
        number_of(file, "rig_metres_per_unit" if "rig_metres_per_unit" in file.attrs else "rig_meters_per_unit"),
        tuple(json.loads(text_of(file, "rig_notes"))),
        calibrated="rig_calibrated" not in file.attrs,
        inferred_up=_inferred_up(json.loads(text_of(file, "inferred_up")) if "inferred_up" in file.attrs else None),
    )


def alignment_to_json(alignment: Alignment) -> str:
    """Return an alignment as JSON text."""
    return json.dumps(
        {
            "aligned_from_calibration": alignment.rotation.tolist(),
            "shift_m": alignment.shift_m.tolist(),
            "scale": alignment.scale,
            "up_axis": alignment.up_axis,
            "calibration_up_axis": alignment.calibration_up_axis,
            "inferred_up": alignment.inferred_up and asdict(alignment.inferred_up),
            "calibration_inferred_up": alignment.calibration_inferred_up and asdict(alignment.calibration_inferred_up),
            "steps": alignment.steps,
        }
    )


def alignment_from_json(text: str) -> Alignment:
    """Return the alignment of a JSON text."""
    data = json.loads(text)
    return Alignment(
        np.array(data["aligned_from_calibration"]), np.array(data["shift_m"]), data["scale"], data["up_axis"],
        data["calibration_up_axis"], tuple(data["steps"]), _inferred_up(data.get("inferred_up")),
        _inferred_up(data.get("calibration_inferred_up")),
    )  # fmt: skip


def _inferred_up(data: dict[str, Any] | None) -> InferredUp | None:
    return None if data is None else InferredUp(tuple(data["direction"]), data["sd_deg"])
