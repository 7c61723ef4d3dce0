"""NWB, written with pynwb and ndx-pose: 3D poses of all people and calibrated cameras in ``processing/behavior``.

Each person has a ``MultiCameraPoseEstimation`` (``PoseEstimation`` with ndx-pose before 0.4) with one
``PoseEstimationSeries`` per keypoint: meters, world axes, ``timestamps`` in s, and the status of each point in
``control``, with its labels in ``control_description``. Results have no confidence, so none is written. Cameras are
``CalibratedCamera`` devices, whose description names the lens model; each is linked by a ``PoseEstimation`` without
series, because 2D keypoints are not part of a result. Fields for which ndx-pose has no place are separate
``TimeSeries``: ``frame_number``, ``<person>_covariance`` (frame, keypoint, 6), and so on.

NWB requires the start time of the session: that of the options, or 1970, which the description calls a placeholder (see
:mod:`posefuse.io.results.nwb_session`). The date on which the file was created is always 1970, and identifiers are
derived from the content, so the same result gives the same bytes.
"""

import hashlib
import json
import mmap
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any
from uuid import UUID, uuid5

import h5py
import numpy as np

from posefuse.errors import FileError, ResultError
from posefuse.io.files import must_exist, replacing
from posefuse.io.hdf5 import open_hdf5
from posefuse.io.results import nwb_session
from posefuse.io.results.format import ResultFacts, ResultFormat
from posefuse.io.results.names import safe_names
from posefuse.model.cameras import Camera
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus
from posefuse.model.stored_points import StoredPoints, stored_points

_NAMESPACE = UUID("8d1b0c0e-3a5f-5d53-9a3c-6f1d1d7a9c11")
_UUID = re.compile(rb"[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}")
_UNITS = {"m": "meters", "px": "pixels"}
_ADDITIONAL = {
    "covariance": ("covariance_m2", "m2", "xx, xy, xz, yy, yz, zz of each keypoint"),
    "source": ("source", "code", "how the coordinates of each keypoint were obtained"),
    "reprojection_error": ("reprojection_error_px", "pixels", "mean over the cameras used for the point"),
    "view_status": ("view_status", "code", "contribution of each camera: (frame, keypoint, camera)"),
    "view_error": ("view_error_px", "pixels", "reprojection error in each camera: (frame, keypoint, camera)"),
}
_RESERVED = ("Skeletons", "frame_number")
_MODULE = "behavior"
_WRITER = "posefuse"


@contextmanager
def _packages() -> Iterator[tuple[ModuleType, ModuleType]]:
    """Import pynwb and ndx-pose with their warnings about each other's version suppressed.

    Raises:
        ResultError: if they are not installed.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            import ndx_pose
            import pynwb
        except ImportError as error:
            raise ResultError(
                f"NWB needs the packages pynwb and ndx-pose ({error}). Install them: pip install 'posefuse[nwb]'."
            ) from None
        yield pynwb, ndx_pose


def write(result: Reconstruction, path: Path, layer: LayerName) -> None:
    """Write one layer of all people; the whole layer is held in memory.

    Raises:
        ResultError: if the packages are not installed, or frames have no times.
    """
    require(ResultFacts.of(result))
    points = stored_points(result, layer)
    with _packages() as (pynwb, ndx_pose), replacing(path) as temporary:
        content = _file(pynwb, ndx_pose, result, points)
        with pynwb.NWBHDF5IO(temporary, "w") as file:
            file.write(content)
        _derive_ids(temporary, content.identifier)


def require(facts: ResultFacts) -> None:
    """Refuse results that the file cannot hold.

    Raises:
        ResultError: if the packages are not installed, or frames have no times.
    """
    if not np.isfinite(facts.time_s).all() or not facts.n_frames:
        raise ResultError(
            "An NWB file needs the time of every frame, and this result lacks some times. Reconstruct with `rate_hz`."
        )
    with _packages():
        pass


def _file(pynwb: Any, ndx_pose: Any, result: Reconstruction, points: StoredPoints) -> Any:
    start, subject = nwb_session.start_time(result.options), nwb_session.subject_fields(result.options)
    unknown = "; the session start is unknown, 1970 is a placeholder" if start == nwb_session.UNKNOWN_START else ""
    content = pynwb.NWBFile(
        session_description=f"3D poses by posefuse, layer {points.layer}{unknown}",
        identifier=_identifier(result, points),
        session_start_time=start,
        timestamps_reference_time=start,
        file_create_date=[nwb_session.UNKNOWN_START],
        notes=json.dumps(_description(result, points)),
        keywords=["motion capture", "pose estimation"],
        subject=pynwb.file.Subject(**subject) if subject else None,
    )
    module = content.create_processing_module(_MODULE, "3D poses")
    names = safe_names(result.rig.names)
    cameras = [
        _camera(ndx_pose, camera, name, calibrated=result.rig.calibrated)
        for camera, name in zip(result.rig.cameras, names, strict=True)
    ]
    for camera in cameras:
        content.add_device(camera)
    edges = result.skeleton.edge_indices
    kind = np.uint8 if len(result.skeleton) <= 256 else np.uint16
    skeleton = ndx_pose.Skeleton(
        name="skeleton", nodes=list(points.keypoints), edges=edges.astype(kind) if len(edges) else None
    )
    module.add(ndx_pose.Skeletons(skeletons=[skeleton]))
    clock = pynwb.TimeSeries(
        name="frame_number", data=points.frame_numbers, unit="frame", timestamps=points.time_s,
        description="numbers of the frames in the recording",
    )  # fmt: skip
    module.add(clock)
    for index, (name, additional) in enumerate(_series_names(points.person_ids)):
        module.add(_person(ndx_pose, result, points, index, name, skeleton, cameras, clock))
        for series in _additional_series(pynwb, points, index, additional, clock):
            module.add(series)
    return content


def _series_names(people: Sequence[str]) -> list[tuple[str, dict[str, str]]]:
    """Return for each person the unique names of the poses and, by key, of the additional time series."""
    names = safe_names([*_RESERVED, *people, *(f"{person}_{key}" for person in people for key in _ADDITIONAL)])
    own, rest = names[len(_RESERVED) : len(_RESERVED) + len(people)], names[len(_RESERVED) + len(people) :]
    additional = [rest[i * len(_ADDITIONAL) : (i + 1) * len(_ADDITIONAL)] for i in range(len(people))]
    return [(name, dict(zip(_ADDITIONAL, series, strict=True))) for name, series in zip(own, additional, strict=True)]


def _description(result: Reconstruction, points: StoredPoints) -> dict[str, Any]:
    return {
        "written_by": _WRITER,
        "version": 1,
        "layer": points.layer,
        "unit": points.unit,
        "rate_hz": points.rate_hz,
        "people": points.person_ids,
        "cameras": points.view_names,
        "skeleton": result.skeleton.name,
        "inputs": dict(result.provenance.inputs),
        "versions": dict(result.provenance.versions),
    }


def _identifier(result: Reconstruction, points: StoredPoints) -> str:
    """Return a hash of the content."""
    session = [nwb_session.start_time(result.options), nwb_session.subject_fields(result.options)]
    digest = hashlib.sha256(json.dumps([_description(result, points), session], default=str).encode())
    for values in (points.frame_numbers, points.time_s, points.points_m, points.covariance_m2):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def _camera(ndx_pose: Any, camera: Camera, name: str, *, calibrated: bool) -> Any:
    size = f"{camera.size_px[0]} x {camera.size_px[1]} px"
    description = f"{camera.name}: {camera.lens} lens, OpenCV coefficients, {size}; meters, world to camera"
    if not calibrated or not hasattr(ndx_pose, "CalibratedCamera"):
        description = description if calibrated else f"{camera.name}: without calibration"
        from pynwb.device import Device

        return Device(name=name, description=description)
    return ndx_pose.CalibratedCamera(
        name=name,
        description=description,
        intrinsic_matrix=camera.matrix,
        rotation_matrix=camera.rotation,
        translation_vector=camera.translation_m,
        distortion_coefficients=np.array(camera.distortion) if camera.distortion else None,
    )


def _person(
    ndx_pose: Any, result: Reconstruction, points: StoredPoints, index: int, name: str, skeleton: Any, cameras: Any,
    clock: Any,
) -> Any:  # fmt: skip
    assert points.status is not None
    words = [code.label for code in PointStatus]
    number = np.full(256, 255, dtype=np.uint8)
    number[[code.value for code in PointStatus]] = np.arange(len(words))
    series = [
        ndx_pose.PoseEstimationSeries(
            name=safe,
            description=keypoint,
            data=points.points_m[:, index, k],
            unit=_UNITS[points.unit],
            reference_frame=_reference(result),
            timestamps=clock,
            control=number[points.status[:, index, k]],
            control_description=words,
        )
        for k, (keypoint, safe) in enumerate(zip(points.keypoints, safe_names(points.keypoints), strict=True))
    ]
    arguments = {
        "name": name,
        "pose_estimation_series": series,
        "description": f"3D keypoints of {points.person_ids[index]}, layer {points.layer}",
        "scorer": f"posefuse, {result.options.triangulation.method}",
        "source_software": "posefuse",
        "source_software_version": result.provenance.versions.get("posefuse"),
        "skeleton": skeleton,
    }
    if not hasattr(ndx_pose, "MultiCameraPoseEstimation"):
        return ndx_pose.PoseEstimation(**arguments)
    names = safe_names([*points.keypoints, *(f"view_{camera.name}" for camera in cameras)])[len(points.keypoints) :]
    views = [
        ndx_pose.PoseEstimation(
            name=name,
            device=camera,
            skeleton=skeleton,
            description="camera of the recording; its 2D keypoints are not stored",
        )
        for name, camera in zip(names, cameras, strict=True)
    ]
    return ndx_pose.MultiCameraPoseEstimation(**arguments, pose_estimations=views)


def _reference(result: Reconstruction) -> str:
    up = "the up axis is unknown" if result.rig.up_axis is None else f"{result.rig.up_text} is up"
    aligned = ", aligned by posefuse" if result.alignment is not None else ""
    return f"(0, 0, 0) is the origin of the calibration{aligned}; right-handed, {up}"


def _additional_series(
    pynwb: Any, points: StoredPoints, index: int, names: dict[str, str], clock: Any
) -> Iterator[Any]:
    for key, (attribute, unit, description) in _ADDITIONAL.items():
        yield pynwb.TimeSeries(
            name=names[key],
            data=np.array(getattr(points, attribute)[:, index]),
            unit=unit,
            timestamps=clock,
            description=description,
        )


def _derive_ids(path: Path, identifier: str) -> None:
    """Replace the random identifiers of objects by ones derived from the file's content and the object's path.

    The bytes of the file are edited, because HDF5 would leave the old text of an attribute in unreferenced space.
    """
    new_ids: dict[bytes, bytes] = {}

    def add_id(name: str, item: Any) -> None:
        if "object_id" in item.attrs:
            new_ids[str(item.attrs["object_id"]).encode()] = str(uuid5(_NAMESPACE, f"{identifier}/{name}")).encode()

    with h5py.File(path, "r") as file:
        add_id("", file)
        file.visititems(add_id)
    with path.open("r+b") as file, mmap.mmap(file.fileno(), 0) as content:
        old_ids = [(match.start(), match.group()) for match in _UUID.finditer(content) if match.group() in new_ids]
        for start, old in old_ids:
            content[start : start + len(old)] = new_ids[old]


def matches(path: Path) -> bool:
    """Return whether a file is an NWB file."""
    try:
        with h5py.File(path) as file:
            return "nwb_version" in file.attrs
    except (OSError, KeyError, ValueError, RuntimeError):
        return False


def read(path: Path) -> StoredPoints:
    """Read a file that posefuse wrote; requires only h5py.

    Raises:
        FileError: if it is not such a file, or corrupt.
    """
    must_exist(path, "NWB file")
    with open_hdf5(path, "NWB file") as file:
        head: Any = json.loads(_text(file, "general/notes"))
        if not isinstance(head, dict) or head.get("written_by") != _WRITER:
            raise FileError(f"{path} is an NWB file that posefuse did not write; read it with pynwb.")
        return _points(file[f"processing/{_MODULE}"], head)


def _text(file: h5py.File, name: str) -> str:
    text: Any = file[name][()] if name in file else b"null"  # type: ignore[index]
    return text.decode() if isinstance(text, bytes) else str(text)


def _points(module: Any, head: dict[str, Any]) -> StoredPoints:
    nodes = tuple(node.decode() for node in np.asarray(module["Skeletons/skeleton/nodes"]).tolist())
    series, keypoints = _series_names(head["people"]), safe_names(nodes)
    people = [name for name, _ in series]

    def stack(parts: list[np.ndarray]) -> np.ndarray:
        """Return the parts as one array of shape (frame, part, ...)."""
        return np.stack(parts, axis=1)

    codes = np.array([code.value for code in PointStatus], dtype=np.int8)
    values = {
        attribute: stack([np.asarray(module[f"{additional[key]}/data"]) for _, additional in series])
        for key, (attribute, *_) in _ADDITIONAL.items()
    }
    return StoredPoints(
        keypoints=nodes,
        person_ids=tuple(head["people"]),
        frame_numbers=np.asarray(module["frame_number/data"]),
        time_s=np.asarray(module["frame_number/timestamps"]),
        points_m=stack([stack([np.asarray(module[f"{p}/{k}/data"]) for k in keypoints]) for p in people]),
        status=stack([stack([codes[np.asarray(module[f"{p}/{k}/control"])] for k in keypoints]) for p in people]),
        unit=head["unit"],
        layer=head["layer"],
        rate_hz=head["rate_hz"],
        view_names=tuple(head["cameras"]),
        **values,
    )


FORMAT = ResultFormat(
    name="nwb",
    files="*.nwb (needs posefuse[nwb])",
    conventions=(
        "meters, world axes, seconds; one MultiCameraPoseEstimation per person; session start 1970 means unknown"
    ),
    require=require,
    remarks=nwb_session.remarks,
    additional_name="points.nwb",
    endings=(".nwb",),
    matches=matches,
    read=read,
    write_layer=write,
)
