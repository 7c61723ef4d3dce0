"""posefuse's own keypoint file in netCDF-4. It stores all of :class:`Detections` and is read by ranges."""

from pathlib import Path

import numpy as np

from posefuse.errors import FileError
from posefuse.io.files import reading, replacing
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.request import Request, apply_request
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
from posefuse.model.detections import Detections

KIND = "keypoints"


def matches(path: Path) -> bool:
    """Return whether a file is in this format."""
    if path.suffix != ".nc" or not path.is_file():
        return False
    try:
        open_file(path, KIND).close()
    except FileError:
        return path.name == "keypoints.nc"
    return True


def read(path: Path, request: Request) -> Detections:
    """Open a file. Long arrays stay in the file and are read on demand.

    Raises:
        FileError: If the file is truncated or in another format.
        SkeletonError: If the stored keypoints cannot be mapped to the requested skeleton.
    """
    with reading(path, "netCDF-4 file"), open_file(path, KIND) as file:
        rate = number_of(file, "rate_hz") if "rate_hz" in file.attrs else None
        detections = Detections(
            skeleton=skeleton_from_text(text_of(file, "skeleton")),
            view_names=strings(file.variables["view"]),
            frame_numbers=np.asarray(file.variables["frame_number"][...]),
            time_s=np.asarray(file.variables["time_s"][...]),
            offsets=np.asarray(file.variables["offsets"][...]),
            keypoints_px=stored_array(path, "keypoints_px"),
            confidence=stored_array(path, "confidence"),
            recorded=np.asarray(file.variables["recorded"][...]).astype(bool),
            track_ids=stored_array(path, "track_id"),
            depth=stored_array(path, "depth") if "depth" in file.variables else None,
            sigma_px=stored_array(path, "sigma_px") if "sigma_px" in file.variables else None,
            rate_hz=rate,
            notes=strings(file.variables["note"]) if "note" in file.variables else (),
        )
    return apply_request(detections, request, path)


def write(detections: Detections, path: Path) -> None:
    """Write detections, one range of frames after another.

    Raises:
        FileError: If the file cannot be written.
    """
    rows = int(detections.offsets[-1])
    with replacing(path) as temporary, OutputFile(temporary) as file:
        file.attrs["posefuse_kind"] = KIND
        file.attrs["skeleton"] = skeleton_text(detections.skeleton)
        if detections.rate_hz is not None:
            file.attrs["rate_hz"] = float(detections.rate_hz)
        file.add_dimensions(
            {
                "frame": detections.n_frames,
                "view": detections.n_views,
                "cell": len(detections.offsets),
                "row": rows,
                "keypoint": len(detections.skeleton),
                "pixel": 2,
                "note": len(detections.notes),
            }
        )
        add_variable(file, "view", ("view",), np.array(detections.view_names))
        add_variable(file, "keypoint", ("keypoint",), np.array(detections.skeleton.keypoints))
        add_variable(file, "frame_number", ("frame",), detections.frame_numbers)
        add_variable(file, "time_s", ("frame", "view"), detections.time_s, units="s")
        add_variable(file, "recorded", ("frame", "view"), detections.recorded.astype(np.int8))
        add_variable(file, "offsets", ("cell",), detections.offsets)
        if detections.notes:
            add_variable(file, "note", ("note",), np.array(detections.notes))
        add_variable(file, "keypoints_px", ("row", "keypoint", "pixel"), dtype="f8", units="px")
        add_variable(file, "confidence", ("row", "keypoint"), dtype="f8")
        add_variable(file, "track_id", ("row",), dtype="i8")
        long = {"keypoints_px": "keypoints_px", "confidence": "confidence", "track_ids": "track_id"}
        for name in ("depth", "sigma_px"):
            if getattr(detections, name) is not None:
                add_variable(file, name, ("row", "keypoint"), dtype="f8")
                long[name] = name
        start = 0
        for chunk in detections.chunks():
            for field, name in long.items():
                write_rows(file, name, start, getattr(chunk, field))
            start += int(chunk.offsets[-1])


def lost(detections: Detections, path: Path) -> tuple[str, ...]:
    """Return what of the detections is lost in the file: nothing."""
    return ()


FORMAT = KeypointFormat(
    name="posefuse",
    files="keypoints.nc",
    conventions="px; netCDF-4; any number of people; times, confidences and skeleton; lossless",
    recognized_by="netCDF-4 with posefuse's keypoint marker",
    matches=matches,
    read=read,
    write=write,
    lost=lost,
    endings=(".nc",),
)
