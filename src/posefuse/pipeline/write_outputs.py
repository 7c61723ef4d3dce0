"""Write the outputs of a reconstruction beside its ``reconstruction.nc``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from posefuse.biomechanics.gait import Gait
from posefuse.biomechanics.tables import body_tables
from posefuse.errors import OptionsError, ResultError, suggestion
from posefuse.evaluation.error_profile import error_profile
from posefuse.io.results import netcdf, netcdf_angles
from posefuse.io.results.figures import has_figures, write_figure
from posefuse.io.results.format import ResultFacts
from posefuse.io.results.names import safe_names
from posefuse.io.results.netcdf_contact import add_contact
from posefuse.io.results.open_result import open_result
from posefuse.io.results.write import (
    OutputFile,
    Table,
    additional_names,
    default_files,
    people_with_frames,
    require_formats,
    write_also,
    write_files,
)
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import LayerName, Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.track_events import Event
from posefuse.parallel import ONE_JOB, Jobs
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


def write_outputs(
    result: Reconstruction, folder: Path, progress: Progress, recording: str = "", jobs: Jobs = ONE_JOB
) -> WrittenOutputs:
    """Write everything beside ``reconstruction.nc``, to which joint angles and contacts are added.

    Args:
        result: the result in ``reconstruction.nc`` of the folder.
        folder: output folder.
        progress: receives the progress.
        recording: name of the recording in the report.
        jobs: processes that estimate joint angles and write files.
    """
    path = folder / RESULT
    if path.exists():
        parts = report_ranges(joint_angles(result, jobs), result.n_frames, "estimating joint angles", progress)
        netcdf_angles.add(parts, path)
        result = netcdf.read_reconstruction(path)
    gait = analyze_gait(result)
    tables: dict[str, Table] = dict(body_tables(result))
    movements: Sequence[Event] = ()
    if gait is not None:
        tables |= {name: partial(_known_columns, columns) for name, columns in gait.tables().items()}
        movements = gait.events()
        add_contact(path, gait.contact, gait.sliding, gait.layer)
    files, unwritten = default_files(result, tables, movements)
    if not unwritten and has_figures(result):
        people = people_with_frames(result)
        stems = zip(people, safe_names(people), strict=True)
        files += [OutputFile(stem, partial(write_figure, person, stem)) for person, stem in stems]
    people = None if gait is None else gait.people
    # The report takes long: written last, it would leave the other processes idle.
    files = [OutputFile(REPORT, partial(_write_report, people, recording)), *files]
    names, remarks = write_files(result, files, folder, progress, jobs)
    names = [*names[1:], *names[:1]]
    lines = () if gait is None else gait.summary()
    layer, _ = result.best_layer(result.options.layer)
    return WrittenOutputs(tuple(names), layer, (*unwritten, *remarks), lines)


def _known_columns(columns: Mapping[str, np.ndarray], _: Reconstruction) -> tuple[Mapping[str, np.ndarray]]:
    """Return a table that is computed already."""
    return (columns,)


def _write_report(
    gait: Mapping[str, Gait] | None, recording: str, result: Reconstruction, folder: Path
) -> tuple[Sequence[str], Sequence[str]]:
    (folder / REPORT).write_text(render_report(result, gait=gait, recording=recording), "utf-8")
    return (REPORT,), ()


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
