"""``posefuse convert``: 2D keypoints, calibrations and results from any format that is read to any that is written."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, count, note, say
from posefuse.errors import FileError, OptionsError, choices, suggestion
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.registry import CALIBRATIONS
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.registry import KEYPOINTS
from posefuse.model.cameras import UpAxis
from posefuse.model.detections import Detections
from posefuse.model.options.options import LayerName, LengthUnit, Options, ThirdChannel
from posefuse.skeleton.skeletons import Skeleton, find_skeleton


def convert(
    path: Annotated[Path, Parameter(help="What to convert: a file, or a folder that holds it.")],
    output: Annotated[
        Path,
        Parameter(name=["--output", "-o"], help="Where to write it: a file, or a folder for formats of many files."),
    ],
    *,
    to: Annotated[str | None, Parameter(help="The format to write; by default by how the output's name ends.")] = None,
    onto: Annotated[
        str | None, Parameter(help="A skeleton whose keypoints to make of those there are, such as body_20.")
    ] = None,
    layer: Annotated[LayerName | None, Parameter(help="Of a result: which layer; by default the best.")] = None,
    skeleton: Annotated[str | None, Parameter(help="What the keypoints are, where files do not say.")] = None,
    rate_hz: Annotated[float | None, Parameter(help="Frames per second, where files do not say.")] = None,
    third_channel: Annotated[ThirdChannel | None, Parameter(help="What an array's third number is.")] = None,
    image_size: Annotated[
        tuple[int, int] | None, Parameter(help="Width and height in px, where keypoints are shares of the image.")
    ] = None,
    length_unit: Annotated[LengthUnit | None, Parameter(help="A calibration's unit, where files do not say.")] = None,
    up: Annotated[UpAxis | None, Parameter(help="The world's up axis, where files do not say.")] = None,
) -> None:
    """Write 2D keypoints, a calibration or a stored result in another format.

    posefuse formats lists what is read and written. What the new format cannot hold is said. Nothing that exists is
    written over.
    """
    options = Options(
        skeleton=skeleton,
        rate_hz=rate_hz,
        third_channel=third_channel,
        image_size=image_size or (),
        length_unit=length_unit,
        up=up,
        layer=layer,
    )
    _must_be_new(output)
    if _is_result(path):
        from posefuse.cli.convert_result import convert_result

        convert_result(path, to, output, layer)
        return
    written = (*KEYPOINTS.written(), *CALIBRATIONS.written())
    names = list(dict.fromkeys(form.name for form in written))
    name = to or next((form.name for form in written if output.name.endswith(form.endings)), None)
    if path.is_file() and _holds_points(path):
        raise OptionsError(
            f"{path.name} holds 3D points, which are read to compare with (posefuse evaluate RESULT {path.name}), not "
            "to be written again: convert the result that they are of."
        )
    if name is None and output.suffix in (".trc", ".c3d", ".bvh", ".glb"):
        raise OptionsError(f"{output.name} would hold 3D results: posefuse reconstruct makes them of a recording.")
    if name is None:
        raise OptionsError(f"Which format is {output.name} to be? Add --to: {choices(names, 20)}.")
    keypoints, calibration = KEYPOINTS.find_written(name), CALIBRATIONS.find_written(name)
    if keypoints is None and calibration is None:
        raise OptionsError(f"--to: {name!r} is no format that keypoints or calibrations are written in. "
                           f"{suggestion(name, names)}")  # fmt: skip
    source, reads = _source(path, keypoints, calibration)
    if reads == "keypoints" and keypoints is not None:
        _convert_keypoints(source, output, keypoints, onto, options)
    elif reads == "a calibration" and calibration is not None:
        _convert_calibration(source, output, calibration, options)
    else:
        raise OptionsError(f"{source} holds {reads}, which is not written as {name}.")


def _must_be_new(output: Path) -> None:
    if output.is_file():
        raise FileError(f"{output} exists already; choose another name or remove it.")


def _is_result(path: Path) -> bool:
    from posefuse.io.netcdf import open_file

    file = path / "reconstruction.nc" if path.is_dir() else path
    if file.suffix != ".nc" or not file.is_file():
        return False
    try:
        open_file(file, "reconstruction").close()
    except FileError:
        return False
    return True


def _holds_points(path: Path) -> bool:
    from posefuse.io.keypoints.read import find_format
    from posefuse.io.results.read import holds_points

    return find_format(path) is None and holds_points(path)


def _source(path: Path, keypoints: KeypointFormat | None, calibration: CalibrationFormat | None) -> tuple[Path, str]:
    """What is to be read, and whether it is ``keypoints`` or ``a calibration``."""
    from posefuse.io.calibration.read import find_format as calibration_format
    from posefuse.io.files import must_exist
    from posefuse.io.keypoints.read import find_format as keypoint_format
    from posefuse.io.recording import choose_calibration, choose_keypoints, find_recording

    must_exist(path, "recording")
    if keypoints is not None and keypoint_format(path) is not None:
        return path, "keypoints"
    if calibration is not None and calibration_format(path) is not None:
        return path, "a calibration"
    if path.is_file():
        if keypoint_format(path) is not None:
            return path, "keypoints"
        if calibration_format(path) is not None:
            return path, "a calibration"
        raise FileError(f"{path} is in no format that is known, or was cut short. posefuse formats lists them.")
    found = find_recording(path)
    if keypoints is not None:
        return choose_keypoints(found), "keypoints"
    return choose_calibration(found), "a calibration"


def _convert_keypoints(source: Path, output: Path, form: KeypointFormat, onto: str | None, options: Options) -> None:
    from posefuse.io.keypoints.read import read_keypoints
    from posefuse.io.keypoints.request import Request

    detections = read_keypoints(source, Request.of(options, Bars()))
    for text in detections.notes:
        note(f"note: {text}")
    if onto is not None:
        detections = _mapped(detections, find_skeleton(onto))
    assert form.write is not None
    form.write(detections, output)
    lost = form.lost(detections, output) if form.lost is not None else ()
    people = int(detections.people_counts.max(initial=0))
    say(
        f"{count(detections.n_frames, 'frame')}, {count(detections.n_views, 'view')}, up to "
        f"{count(people, 'person') if people == 1 else f'{people} people'} a view, skeleton {detections.skeleton.name}"
    )
    say(f"Wrote {output} ({form.name})")
    for what in lost:
        note(f"note: {form.name} cannot hold {what}.")


def _mapped(detections: Detections, skeleton: Skeleton) -> Detections:
    """The keypoints of another skeleton; what cannot be had is said."""
    held = detections.skeleton.sources_of(skeleton)
    if not held:
        raise OptionsError(
            f"--onto {skeleton.name}: nothing of it can be made of the keypoints of {detections.skeleton.name}."
        )
    lacking = [name for name in skeleton.keypoints if name not in held]
    if lacking:
        note(f"note: {detections.skeleton.name} has nothing for {choices(lacking)} of {skeleton.name}.")
    return detections.to_skeleton(skeleton)


def _convert_calibration(source: Path, output: Path, form: CalibrationFormat, options: Options) -> None:
    from posefuse.io.calibration.read import read_cameras
    from posefuse.io.calibration.write import write_as

    rig = read_cameras(source, length_unit=options.length_unit, up=options.up)
    for text in rig.notes:
        note(f"note: {text}")
    write_as(form, rig, output)
    say(f"{count(len(rig), 'camera')}, up axis {rig.up_axis or 'unknown'}")
    say(f"Wrote {output} ({form.name})")
