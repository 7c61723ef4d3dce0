"""Write the outputs of a reconstruction beside its ``reconstruction.nc``."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from posefuse.biomechanics.tables import body_tables
from posefuse.errors import OptionsError, ResultError, suggestion
from posefuse.evaluation.error_profile import error_profile
from posefuse.io.results import netcdf, netcdf_angles
from posefuse.io.results.figures import write_figures
from posefuse.io.results.format import ResultFacts
from posefuse.io.results.netcdf_contact import add_contact
from posefuse.io.results.open_result import open_result
from posefuse.io.results.write import additional_names, people_with_frames, require_formats, write_also, write_folder
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import LayerName, Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.defaults import RecordingFacts, resolve_people
from posefuse.pipeline.fingerprints import RESULT
from posefuse.pipeline.gait import analyze_gait
from posefuse.pipeline.joint_angles import joint_angles
from posefuse.pipeline.measured_layer import reconstruct_chunks
from posefuse.pipeline.people.stills import STILLS
from posefuse.pipeline.plan import Plan
from posefuse.pipeline.reconstruct import used_inputs, with_method
from posefuse.pipeline.solved_layer import mean_times
from posefuse.progress import Progress, report_ranges
from posefuse.report.html import render_report
from posefuse.report.matplotlib_extra import has_matplotlib
from posefuse.triangulation.method import DebugFigure
from posefuse.triangulation.registry import find_method

REPORT = "report.html"


@dataclass(frozen=True)
class WrittenOutputs:
    """The outputs written beside ``reconstruction.nc``.

    Attributes:
        files: names of the files.
        layer: the layer that TRC and C3D hold.
        remarks: what the formats cannot hold.
        gait: a line for each person with gait, jumps, squats or rises from a seat.
    """

    files: tuple[str, ...]
    layer: LayerName
    remarks: tuple[str, ...]
    gait: tuple[str, ...] = ()


def write_outputs(result: Reconstruction, folder: Path, progress: Progress, recording: str = "") -> WrittenOutputs:
    """Write everything beside ``reconstruction.nc``, to which joint angles and contacts are added.

    Args:
        result: the result in ``reconstruction.nc`` of the folder.
        folder: output folder.
        progress: receives the progress.
        recording: name of the recording in the report.
    """
    path = folder / RESULT
    if path.exists():
        parts = report_ranges(joint_angles(result), result.n_frames, "estimating joint angles", progress)
        netcdf_angles.add(parts, path)
        result = netcdf.read_reconstruction(path)
    gait = analyze_gait(result)
    tables, movements = dict(body_tables(result)), ()
    if gait is not None:
        tables |= gait.tables()
        movements = gait.events()
        add_contact(path, gait.contact, gait.sliding, gait.layer)
    files, layer, unwritten = write_folder(result, folder, progress, tables, movements)
    figures, remarks = ([], []) if unwritten else write_figures(result, people_with_frames(result), folder, progress)
    people = None if gait is None else gait.people
    report = render_report(result, progress=progress, gait=people, recording=recording)
    (folder / REPORT).write_text(report, "utf-8")
    lines = () if gait is None else gait.summary()
    return WrittenOutputs((*files, *figures, REPORT), layer, (*unwritten, *remarks), lines)


def require_known_formats(also: Sequence[str]) -> None:
    """Refuse unknown format names before any work is done.

    Raises:
        OptionsError: if a format cannot be written beside a result.
    """
    offered = additional_names() if also else {}
    for name in also:
        if name not in offered:
            raise OptionsError(
                f"`also={[name]!r}`: there is no additional format with this name. {suggestion(name, offered)}"
            )


def require_possible_formats(also: Sequence[str], rig: CameraRig, detections: Detections, options: Options) -> None:
    """Refuse formats that cannot hold the result, before the work that takes time.

    Args:
        also: names of formats.
        rig: calibrated cameras.
        detections: 2D keypoints.
        options: options of the reconstruction.

    Raises:
        PosefuseError: if a format cannot hold the result, or views and cameras do not match.
    """
    if not also:
        return
    rig, detections, _ = used_inputs(rig, detections, options)
    facts = ResultFacts(
        "px" if len(rig) == 1 else "m", detections.skeleton, rig.names, detections.frame_numbers,
        mean_times(detections), detections.rate_hz,
        has_identities=resolve_people(options, RecordingFacts.of(detections), len(rig)).people != STILLS,
    )  # fmt: skip
    try:
        require_formats(also, facts)
    except ResultError as error:
        raise OptionsError(f"`also`: {error}") from None


def write_other_formats(folder: Path, also: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Write the result of a folder in other formats beside it.

    Returns:
        The names of the files, and what the formats cannot hold.
    """
    return write_also(open_result(folder)[1], folder, also) if also else ([], ())


def find_debug_figure(plan: Plan) -> DebugFigure | None:
    """Return the figure that shows what the method did; None without one for this recording, or without matplotlib."""
    if not has_matplotlib():
        return None
    triangulation = plan.options.triangulation
    figure = find_method(triangulation.method).debug_figure
    return figure if figure is not None and figure.applies(plan.rig, triangulation) else None


def write_debug_figures(plan: Plan, result: Reconstruction, folder: Path, progress: Progress) -> tuple[str, ...]:
    """Write the figures that show what the method did, if it has any, and return their names."""
    figure = find_debug_figure(plan)
    if figure is None:
        return ()
    from posefuse.report.percentile_filter import percentile_filter_figure

    before = error_profile(reconstruct_chunks(with_method(plan, "simple"), progress))
    picture = percentile_filter_figure(before, error_profile(result.chunks()), result)
    (folder / figure.path).parent.mkdir()
    (folder / figure.path).write_bytes(picture.png)
    return (figure.path,)
