"""Vicon's ``.xcp`` (XML): mm, z up; the video cameras of a system, at their first key frame.

``ORIENTATION`` is a quaternion x y z w, world to camera, and ``POSITION`` the camera's position in mm. Focal length and
principal point are in px of the sensor; the video shows its central part. ``VICON_RADIAL2`` is a word, two unused
numbers (distortion is about the principal point), k1, k2 and optionally k3; ``VICON_RADIAL`` is k1 and k2.
"""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from posefuse.errors import FileError
from posefuse.io.calibration.camera_records import CameraRecord, as_numbers, build_rig, small_text
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.files import parse_xml
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    return path.suffix.lower() == ".xcp" and path.is_file()


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the video cameras in the order of the file.

    Raises:
        FileError: if the file does not conform to its format, or has no video camera.
        CameraError: if a camera's parameters are invalid.
    """
    root = parse_xml(path, small_text(path))
    elements = list(root.iter("Camera"))
    videos = [element for element in elements if element.get("SYSTEM") == "DV"]
    if not videos:
        raise FileError(f"{path} has no video camera: expected Camera@SYSTEM = 'DV', got {len(elements)} others.")
    return build_rig(path, [_camera(path, element) for element in videos], unit, "mm", "z")


def _camera(path: Path, element: ElementTree.Element) -> CameraRecord:
    name = element.get("DEVICEID") or element.get("USERID") or ""
    frame = next(element.iter("KeyFrame"), None)
    if frame is None:
        raise FileError(f"{path}, camera {name!r} has no KeyFrame: the camera was not calibrated.")

    def numbers(node: ElementTree.Element, attribute: str, count: int) -> np.ndarray:
        values = as_numbers((node.get(attribute) or "").split(), f"{path}, camera {name!r}: {attribute}")
        if values.size != count:
            raise FileError(f"{path}, camera {name!r}: {attribute} must contain {count} numbers, got {values.size}.")
        return values

    sensor = numbers(element, "SENSOR_SIZE", 2)
    video = numbers(element, "VIDEO_SIZE", 2) if element.get("VIDEO_SIZE") else sensor
    aspect = numbers(element, "PIXEL_ASPECT_RATIO", 1)[0] if element.get("PIXEL_ASPECT_RATIO") else 1.0
    focal = numbers(frame, "FOCAL_LENGTH", 1)[0]
    cu, cv = numbers(frame, "PRINCIPAL_POINT", 2) - (sensor - video) / 2.0
    if not aspect > 0:
        raise FileError(f"{path}, camera {name!r}: PIXEL_ASPECT_RATIO must be positive, got {aspect:g}.")
    matrix = np.array([[focal, 0.0, cu], [0.0, focal / aspect, cv], [0.0, 0.0, 1.0]])
    turn = _rotation(path, name, numbers(frame, "ORIENTATION", 4))
    center = numbers(frame, "POSITION", 3)
    return CameraRecord(name, matrix, turn, -turn @ center, _radial(path, name, frame), tuple(video))


def _radial(path: Path, name: str, frame: ElementTree.Element) -> np.ndarray:
    """Return k1 k2 p1 p2 k3."""
    where = f"{path}, camera {name!r}: radial distortion"
    if frame.get("VICON_RADIAL2"):
        tokens = frame.get("VICON_RADIAL2", "").split()[3:6]
    else:
        tokens = frame.get("VICON_RADIAL", "").split()[:2]
    k1, k2, k3 = np.concatenate([as_numbers(tokens, where), np.zeros(3)])[:3]
    return np.array([k1, k2, 0.0, 0.0, k3])


def _rotation(path: Path, name: str, quaternion: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    if not np.linalg.norm(quaternion) > 0.0:
        raise FileError(f"{path}, camera {name!r}: ORIENTATION is not a rotation: {quaternion.tolist()}.")
    return Rotation.from_quat(quaternion).as_matrix()


FORMAT = CalibrationFormat(
    name="vicon",
    files="*.xcp",
    conventions="mm, z up; quaternion world to camera; k1 k2 k3; video cameras only",
    recognized_by="XML of cameras with key frames",
    matches=matches,
    read=read,
)
