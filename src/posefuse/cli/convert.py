"""``posefuse convert``: convert 2D keypoints, calibrations and results between formats."""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, count, note, say
from posefuse.cli.types import Overwrite
from posefuse.errors import FileError, OptionsError, choices, suggestion
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.calibration.registry import CALIBRATIONS
from posefuse.io.keypoints.format import KeypointFormat
from posefuse.io.keypoints.registry import KEYPOINTS
from posefuse.model.cameras import UpAxis
from posefuse.model.detections import Detections
from posefuse.model.options.options import LayerName, LengthUnit, Options, ThirdChannel
from posefuse.model.options.subject import Sex
from posefuse.skeleton.skeletons import Skeleton, find_skeleton


@dataclass(frozen=True)
class _Interpretation:
    """Flags of what the input's files do not state."""

    layer: Annotated[LayerName | None, Parameter(help="Layer of a result; by default the best one.")] = None
    skeleton: Annotated[str | None, Parameter(help="Keypoint set, if the files do not state it.")] = None
    rate_hz: Annotated[float | None, Parameter(help="Frame rate, if the files do not state it.")] = None
    third_channel: Annotated[
        ThirdChannel | None, Parameter(help="Meaning of the third number of a keypoint array.")
    ] = None
    image_size: Annotated[
        tuple[int, int] | None, Parameter(help="Width and height in px, for keypoints given as fractions of the image.")
    ] = None
    length_unit: Annotated[
        LengthUnit | None, Parameter(help="Length unit of a calibration, if its format does not define it.")
    ] = None
    up: Annotated[UpAxis | None, Parameter(help="Up axis of a calibration, if its format does not define it.")] = None

    @property
    def options(self) -> Options:
        """The flags as options; invalid values raise OptionsError."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return Options(**{**values, "image_size": self.image_size or ()})


@dataclass(frozen=True)
class SessionFlags:
    """Flags of the session and the subject in NWB files; by default those of the result."""

    session_start: Annotated[
        str | None, Parameter(help="Date and time of the result's time 0 with time zone, in NWB files.")
    ] = None
    id: Annotated[str | None, Parameter(name="--subject.id", help="Identifier of the subject in NWB files.")] = None
    species: Annotated[
        str | None, Parameter(name="--subject.species", help="Species in NWB files, such as Mus musculus.")
    ] = None
    sex: Annotated[Sex | None, Parameter(name="--subject.sex", help="Sex in NWB files: F, M, U or O.")] = None
    age: Annotated[
        str | None, Parameter(name="--subject.age", help="Age in NWB files as an ISO 8601 duration, such as P25Y.")
    ] = None
    date_of_birth: Annotated[
        str | None, Parameter(name="--subject.date-of-birth", help="Date of birth in NWB files, such as 1998-04-12.")
    ] = None

    def applied_to(self, options: Options) -> Options:
        """Return the options of a result with the given flags."""
        given = {field.name: value for field in fields(self) if (value := getattr(self, field.name)) is not None}
        start = given.pop("session_start", options.session_start)
        return replace(options, session_start=start, subject=replace(options.subject, **given))


def convert(
    path: Annotated[Path, Parameter(help="File to convert, or a folder that contains it.")],
    output: Annotated[
        Path,
        Parameter(name=["--output", "-o"], help="Output file, or a folder for formats of many files."),
    ],
    *,
    to: Annotated[
        str | None, Parameter(help="Format to write; by default selected by the suffix of the output.")
    ] = None,
    onto: Annotated[str | None, Parameter(help="Skeleton to convert the keypoints to, such as body_20.")] = None,
    overwrite: Overwrite = False,
    interpretation: Annotated[_Interpretation, Parameter(name="*", group="Input")] = _Interpretation(),
    session: Annotated[SessionFlags, Parameter(name="*", group="Session")] = SessionFlags(),
) -> None:
    """Convert 2D keypoints, a calibration or a stored result to another format.

    posefuse formats lists the formats. A note states what the new format cannot hold.
    """
    from posefuse.io.outputs import check_new_files, check_new_folder

    options = interpretation.options
    if _is_result(path):
        from posefuse.cli.convert_result import convert_result

        convert_result(path, to, output, options.layer, session.applied_to, overwrite=overwrite)
        return
    written = (*KEYPOINTS.written(), *CALIBRATIONS.written())
    names = list(dict.fromkeys(form.name for form in written))
    name = to or next((form.name for form in written if output.name.endswith(form.endings)), None)
    if path.is_file() and _holds_points(path):
        raise OptionsError(
            f"{path.name} contains 3D points, which posefuse reads only as ground truth (posefuse evaluate RESULT "
            f"{path.name}). Convert the result that they come from."
        )
    if name is None and output.suffix in (".trc", ".c3d", ".bvh", ".glb"):
        raise OptionsError(
            f"{output.name} would contain 3D results, which posefuse convert cannot make from 2D keypoints. Use "
            "posefuse reconstruct."
        )
    if name is None:
        raise OptionsError(f"The format of {output.name} is unknown. Add --to, one of: {choices(names, 20)}.")
    keypoints, calibration = KEYPOINTS.find_written(name), CALIBRATIONS.find_written(name)
    if keypoints is None and calibration is None:
        raise OptionsError(f"--to: posefuse cannot write keypoints or calibrations as {name!r}. "
                           f"{suggestion(name, names)}")  # fmt: skip
    source, reads = _source(path, keypoints, calibration)
    if output.exists() and output.resolve() == source.resolve():
        raise FileError(f"--output {output} is the input itself. Choose another output.")
    if any(form is not None and form.endings for form in (keypoints, calibration)):
        check_new_files([output], overwrite=overwrite)
    else:
        check_new_folder(output, overwrite=overwrite)
    if reads == "keypoints" and keypoints is not None:
        _convert_keypoints(source, output, keypoints, onto, options)
    elif reads == "a calibration" and calibration is not None:
        _convert_calibration(source, output, calibration, options)
    else:
        raise OptionsError(f"{source} contains {reads}, which posefuse cannot write as {name}.")


def _is_result(path: Path) -> bool:
    from posefuse.io.netcdf import open_file
    from posefuse.io.results.open_result import result_file

    file = result_file(path)
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
    """Return the path to read, and whether it holds ``keypoints`` or ``a calibration``."""
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
        raise FileError(f"{path} is not in a known format or is truncated. posefuse formats lists the formats.")
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
    missing = form.lost(detections, output) if form.lost is not None else ()
    people = int(detections.people_counts.max(initial=0))
    say(
        f"{count(detections.n_frames, 'frame')}, {count(detections.n_views, 'view')}, up to "
        f"{'1 person' if people == 1 else f'{people} people'} per view, skeleton {detections.skeleton.name}"
    )
    say(f"Wrote {output} ({form.name})")
    for what in missing:
        note(f"note: {form.name} cannot hold {what}.")


def _mapped(detections: Detections, skeleton: Skeleton) -> Detections:
    """Convert keypoints to another skeleton and print which keypoints it lacks."""
    held = detections.skeleton.sources_of(skeleton)
    if not held:
        raise OptionsError(
            f"--onto {skeleton.name}: none of its keypoints can be derived from {detections.skeleton.name}."
        )
    lacking = [name for name in skeleton.keypoints if name not in held]
    if lacking:
        note(f"note: {detections.skeleton.name} has no equivalent of {choices(lacking)} of {skeleton.name}.")
    return detections.to_skeleton(skeleton)


def _convert_calibration(source: Path, output: Path, form: CalibrationFormat, options: Options) -> None:
    from posefuse.io.calibration.read import read_cameras
    from posefuse.io.calibration.write import write_as

    rig = read_cameras(source, length_unit=options.length_unit, up=options.up)
    for text in rig.notes:
        note(f"note: {text}")
    write_as(form, rig, output)
    say(f"{count(len(rig), 'camera')}, up axis {rig.up_text}")
    say(f"Wrote {output} ({form.name})")
