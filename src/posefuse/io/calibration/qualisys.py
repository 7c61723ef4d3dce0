"""Qualisys Track Manager's calibration, ``.qca.txt`` (XML): mm, z up, intrinsics in 1/64 px.

``transform`` is the camera's position (mm) and axes in the world. Qualisys' camera looks along -z with y up, so
``camera_from_world`` has the rotation diag(1, -1, -1) [r_ij] and the center (x, y, z) / 1000. Principal points are
relative to the corner of the video's field of view. Distortion coefficients are dimensionless and read as written.

Cameras that record only markers, according to ``model``, are left out. ``video_resolution`` is the number of lines of
the videos; if it is smaller than that of the field of view, all other numbers refer to 1080 lines.

Files written by posefuse have an element ``posefuse`` with ``note`` and ``left_out``, which other programs ignore.
"""

import math
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from posefuse.errors import CameraError, FileError, choices
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.tables import MAX_PLAUSIBLE, METERS_PER_UNIT
from posefuse.io.files import parse_xml, read_text, replacing
from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.model.options.options import LengthUnit

_SUBPIXELS = 64.0
_FULL_LINES = 1080.0
_CLEARLY_FEWER = 0.9
_CAMERA_AXES = np.diag([1.0, -1.0, -1.0])
"""Qualisys' camera looks along -z with y up, OpenCV's along z with y down."""
_NOT_IN_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")

_TEXT_TAGS = ("note", "left_out")


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    return path.name.endswith((".qca.txt", ".qca.xml")) or (
        path.suffix == ".xml" and "<calibration" in read_text(path)[:2000]
    )


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of the file.

    Raises:
        FileError: if the file does not conform to its format.
        CameraError: if a camera's parameters are invalid.
    """
    root = parse_xml(path, read_text(path))
    scale = METERS_PER_UNIT[unit or "mm"]
    elements = root.findall("./cameras/camera")
    if not elements:
        raise FileError(f"{path} has no cameras: expected calibration/cameras/camera, got <{root.tag}>.")
    videos = [element for element in elements if _is_video(element)] or elements
    cameras = tuple(_camera(path, element, scale) for element in videos)
    left = [element.get("serial", "") for element in elements if element not in videos]
    notes = (f"{path.name}: marker cameras are left out: {choices(left)}.",) if left else ()
    stored_notes, left_out = (
        tuple(each.text or "" for each in root.findall(f"./posefuse/{tag}")) for tag in _TEXT_TAGS
    )
    return CameraRig(cameras, "z", path.name, scale, (*stored_notes, *notes), left_out)


def _is_video(element: ElementTree.Element) -> bool:
    return re.search("video|hybrid|none", element.get("model", "none"), re.IGNORECASE) is not None


def _video_scale(element: ElementTree.Element, lines: float) -> float:
    """Return the size of the video relative to a field of view with ``lines`` lines, such as 2/3 for 720p of 1080."""
    resolution = re.fullmatch(r"(\d{3,4})p", element.get("video_resolution", ""))
    scale = float(resolution.group(1)) / _FULL_LINES if resolution else 1.0
    # A field of view in pixels of the video must not be scaled again.
    return scale if resolution and float(resolution.group(1)) < _CLEARLY_FEWER * lines else 1.0


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
        if not abs(value) < MAX_PLAUSIBLE:
            raise FileError(f"{path}, camera {name!r}: {child}@{attribute} must be a number, got {text!r}.")
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
    share = _video_scale(element, min(size))
    # Pixel (0, 0) is the center of the first pixel at any resolution.
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
    rotation = _CAMERA_AXES @ axes
    center = np.array([number("transform", axis) for axis in "xyz"]) * scale
    try:
        return Camera.from_opencv(name, size, matrix, distortion, rotation, -rotation @ center)
    except CameraError as error:
        raise CameraError(f"{path}: {error}") from None


def write(rig: CameraRig, path: Path) -> None:
    """Write a rig, in mm. Residuals are unknown and written as 0, as other converters to this format do.

    Raises:
        FileError: if up is not z, a lens has coefficients other than k1 k2 p1 p2 k3, or a name has characters that XML
            does not allow.
    """
    if rig.up_axis != "z":
        raise FileError(f"Qualisys's format requires the up axis z, but it is {rig.up_axis or 'unknown'}")
    root = ElementTree.Element("calibration", {"source": "posefuse", "type": "regular"})
    cameras = ElementTree.SubElement(root, "cameras")
    for camera in rig.cameras:
        _add_camera(cameras, camera)
    if rig.notes or rig.left_out:
        element = ElementTree.SubElement(root, "posefuse")
        for tag, texts in zip(_TEXT_TAGS, (rig.notes, rig.left_out), strict=True):
            for text in texts:
                ElementTree.SubElement(element, tag).text = _check_xml_text(text)
    ElementTree.indent(root)
    with replacing(path) as temporary:
        ElementTree.ElementTree(root).write(temporary, "utf-8", xml_declaration=True)


def _check_xml_text(text: str) -> str:
    if _NOT_IN_XML.search(text):
        raise FileError(f"the Qualisys format is XML, which does not allow some characters in {text[:40]!r}")
    return text


def _add_camera(cameras: ElementTree.Element, camera: Camera) -> None:
    if camera.lens not in (LensModel.PINHOLE, LensModel.BROWN):
        raise FileError(
            f"the Qualisys format has only k1 k2 p1 p2 k3, but camera {camera.name!r} has other distortion coefficients"
        )
    k1, k2, p1, p2, k3 = camera.distortion or (0.0,) * 5
    width, height = camera.size_px
    about = {
        "active": "1",
        "avg-residual": 0.0,
        "model": "none",
        "serial": _check_xml_text(camera.name),
        "viewrotation": "0",
    }
    element = ElementTree.SubElement(cameras, "camera", _attributes(about))
    for field in ("fov_marker", "fov_marker_max", "fov_video", "fov_video_max"):
        edges = {"left": "0", "top": "0", "right": str(width - 1), "bottom": str(height - 1)}
        ElementTree.SubElement(element, field, edges)
    axes = _CAMERA_AXES @ camera.rotation
    position = dict(zip("xyz", (camera.center_m / METERS_PER_UNIT["mm"]).tolist(), strict=True))
    rotation = {f"r{i + 1}{j + 1}": float(axes[i, j]) for i in range(3) for j in range(3)}
    ElementTree.SubElement(element, "transform", _attributes(rotation | position))
    (fu, skew, cu), (_, fv, cv), _ = (_SUBPIXELS * camera.matrix).tolist()
    lens = {
        "focalLengthU": fu, "focalLengthV": fv, "centerPointU": cu, "centerPointV": cv, "skew": skew,
        "radialDistortion1": k1, "radialDistortion2": k2, "radialDistortion3": k3,
        "tangentalDistortion1": p1, "tangentalDistortion2": p2,
        "sensorMinU": 0.0, "sensorMinV": 0.0,
        "sensorMaxU": _SUBPIXELS * (width - 1), "sensorMaxV": _SUBPIXELS * (height - 1),
    }  # fmt: skip
    ElementTree.SubElement(element, "intrinsic", _attributes(lens))


def _attributes(values: dict[str, str | float]) -> dict[str, str]:
    return {key: value if isinstance(value, str) else repr(float(value)) for key, value in values.items()}


FORMAT = CalibrationFormat(
    name="qualisys",
    files="*.qca.txt",
    conventions="mm, z up; intrinsics in 1/64 px; camera to world",
    recognized_by="XML of cameras with fov_video and transform",
    matches=matches,
    read=read,
    write=write,
    endings=(".qca.txt", ".qca.xml"),
)
