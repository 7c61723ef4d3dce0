"""Qualisys Track Manager's calibration, ``.qca.txt`` (XML): mm, z up, intrinsics in 1/64 px.

``transform`` gives the camera's place (mm) and its axes in the world, Qualisys' camera looking along -z with y up;
so ``camera_from_world`` has the rotation diag(1, -1, -1) [r_ij] and the centre (x, y, z) / 1000. Principal points
count from the corner of the video's field of view. Distortion coefficients are without dimension and read as written.

Where the file also has cameras that see markers only, told by ``model``, those are left out. ``video_resolution`` says
how many lines the videos have; where these are fewer than the field of view's, all else is of 1080 lines.
"""

import math
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from posefuse.errors import CameraError, FileError, choices
from posefuse.io.calibration.tables import BEYOND_REASON, METRES
from posefuse.io.files import parse_xml, read_text
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.options import LengthUnit

_SUBPIXELS = 64.0
_FULL_LINES = 1080.0
_CLEARLY_FEWER = 0.9


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
    videos = [element for element in elements if _is_video(element)] or elements
    cameras = tuple(_camera(path, element, scale) for element in videos)
    left = [element.get("serial", "") for element in elements if element not in videos]
    notes = (f"{path.name}: cameras for markers are left out: {choices(left)}.",) if left else ()
    return CameraRig(cameras, up_axis="z", source=path.name, metres_per_unit=scale, notes=notes)


def _is_video(element: ElementTree.Element) -> bool:
    return re.search("video|hybrid|none", element.get("model", "none"), re.IGNORECASE) is not None


def _share_of_lines(element: ElementTree.Element, lines: float) -> float:
    """By how much videos are smaller than the field of view of so many lines: 720p of 1080 lines are two thirds."""
    said = re.fullmatch(r"(\d{3,4})p", element.get("video_resolution", ""))
    share = float(said.group(1)) / _FULL_LINES if said else 1.0
    # A field of view that counts the video's own pixels is not scaled again.
    return share if said and float(said.group(1)) < _CLEARLY_FEWER * lines else 1.0


def _camera(path: Path, element: ElementTree.Element, scale: float) -> Camera:
    name = element.get("serial") or element.get("name") or ""

    def number(child: str, attribute: str, default: float | None = None) -> float:
        node = element.find(child)
        text = None if node is None else node.get(attribute)
        if text is None and default is not None:
            return default
        try:
            value = float(text)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
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
    share = _share_of_lines(element, min(size))
    # Pixel (0, 0) is the centre of the first pixel, whatever the size of pixels.
    matrix = np.array([[share, 0.0, 0.5 * share - 0.5], [0.0, share, 0.5 * share - 0.5], [0.0, 0.0, 1.0]]) @ matrix
    size = round(size[0] * share), round(size[1] * share)
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
