"""Qualisys Track Manager's calibration, ``.qca.txt`` (XML): mm, z up, intrinsics in 1/64 px.

``transform`` gives the camera's place (mm) and its axes in the world, Qualisys' camera looking along -z with y up;
so ``camera_from_world`` has the rotation diag(1, -1, -1) [r_ij] and the centre (x, y, z) / 1000. Principal points
count from the corner of the video's field of view. Distortion coefficients are without dimension and read as written.
"""

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from posefuse.errors import CameraError, FileError
from posefuse.io.calibration.tables import BEYOND_REASON, METRES
from posefuse.io.files import parse_xml, read_text
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.options import LengthUnit

_SUBPIXELS = 64.0


def matches(path: Path) -> bool:
    """Whether the file is one."""
    return path.name.endswith((".qca.txt", ".qca.xml")) or (
        path.suffix == ".xml" and "<calibration" in read_text(path)[:2000]
    )


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras, in the file's order.

    Raises:
        FileError: if the file is not what its format says.
        CameraError: if a camera's numbers cannot be.
    """
    root = parse_xml(path, read_text(path))
    scale = METRES[unit or "mm"]
    elements = root.findall("./cameras/camera")
    if not elements:
        raise FileError(f"{path} describes no camera: expected calibration/cameras/camera, got <{root.tag}>.")
    cameras = tuple(_camera(path, element, scale) for element in elements)
    return CameraRig(cameras, up_axis="z", source=path.name, metres_per_unit=scale)


def _camera(path: Path, element: ElementTree.Element, scale: float) -> Camera:
    name = element.get("serial") or element.get("name") or ""

    def number(child: str, attribute: str, default: float | None = None) -> float:
        node = element.find(child)
        text = None if node is None else node.get(attribute)
        if text is None and default is not None:
            return default
        try:
            value = float(text)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            value = math.inf
        if not abs(value) < BEYOND_REASON:
            raise FileError(f"{path}, camera {name!r}: {child}@{attribute} should be a number, got {text!r}.")
        return value

    left, top = number("fov_video", "left"), number("fov_video", "top")
    size = number("fov_video", "right") - left + 1, number("fov_video", "bottom") - top + 1
    matrix = np.array(
        [
            [
                number("intrinsic", "focalLengthU"),
                number("intrinsic", "skew", 0.0),
                number("intrinsic", "centerPointU"),
            ],
            [0.0, number("intrinsic", "focalLengthV"), number("intrinsic", "centerPointV")],
            [0.0, 0.0, _SUBPIXELS],
        ]
    )
    matrix /= _SUBPIXELS
    matrix[0, 2] -= left
    matrix[1, 2] -= top
    distortion = [
        number("intrinsic", "radialDistortion1"),
        number("intrinsic", "radialDistortion2"),
        number("intrinsic", "tangentalDistortion1"),
        number("intrinsic", "tangentalDistortion2"),
        number("intrinsic", "radialDistortion3", 0.0),
    ]
    axes = np.array([[number("transform", f"r{i}{j}") for j in (1, 2, 3)] for i in (1, 2, 3)])
    rotation = np.diag([1.0, -1.0, -1.0]) @ axes
    centre = np.array([number("transform", axis) for axis in "xyz"]) * scale
    try:
        return Camera.from_opencv(name, size, matrix, distortion, rotation, -rotation @ centre)
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from None
