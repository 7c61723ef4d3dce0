"""``posefuse reconstruct``."""

import math
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from platform import python_version
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from cyclopts import Parameter

from posefuse.checkpoint import NO_CHECKPOINT, Checkpoint
from posefuse.cli.console import Bars, count, handle_warnings, note, percent, say, table, warn, wrote
from posefuse.cli.convert_result import also_into, must_be_written
from posefuse.cli.reading import Inputs, must_have_rate, read_inputs
from posefuse.cli.types import (
    Also,
    CalibrationPath,
    EditsPath,
    KeypointsPath,
    OptionFlags,
    Output,
    Recording,
    SyncPath,
    TimestampsPath,
)
from posefuse.errors import PosefuseWarning
from posefuse.model.options.options import LayerName, Options
from posefuse.model.options.tracker import Smoother
from posefuse.model.reconstruction import Reconstruction

if TYPE_CHECKING:
    from posefuse.io.checkpoints import CheckpointFolder
    from posefuse.pipeline.measured_layer import Plan

FILTER_FIGURE = "debug/percentile_filter.png"


def reconstruct(
    recording: Recording,
    *,
    output: Output,
    calibration: CalibrationPath = None,
    keypoints: KeypointsPath = None,
    timestamps: TimestampsPath = None,
    edits: EditsPath = None,
    sync: SyncPath = None,
    smoother: Annotated[Smoother | None, Parameter(help="Short for --tracker.smoother.")] = None,
    max_people: Annotated[int | None, Parameter(help="Short for --tracker.max-people.")] = None,
    align: Annotated[Literal["floor"] | None, Parameter(help="Short for --align.floor feet.")] = None,
    also: Also = (),
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Reconstruct people in 3D from a recording's calibration and 2D keypoints.

    Writes reconstruction.nc (everything), keypoints.csv (measured points), one .trc and .c3d a person, report.html;
    where points are solved over time solved.csv; where bodies are fitted model.csv, angles.csv, events.csv and one .bvh
    and .glb a person; with the method percentile_filter debug/percentile_filter.png.

    A recording of more than --chunk-frames frames is done chunk by chunk. What is done is kept in OUTPUT/.parts until
    the result is there: after whatever ended it, the same command goes on from the last finished chunk. Ctrl-C leaves a
    result of what is done, which says that it is partial.
    """
    from posefuse.io.files import PARTS, replacing_folder

    must_be_written(also)
    short = {name: value for name, value in (("smoother", smoother), ("max_people", max_people)) if value is not None}
    options = replace(options, tracker=replace(options.tracker, **short))
    if align == "floor":
        options = replace(options, align=replace(options.align, floor="feet"))
    if sync is not None:
        from posefuse.io.options import read_sync

        options = replace(options, sync=read_sync(sync))
    after = ExitStack()
    with told_of_parts(output / PARTS), replacing_folder(output, after=after) as staging:
        made = reconstruct_into(
            staging, recording, calibration, keypoints, options, edits, timestamps, parts=output / PARTS
        )
        more, remarks = also_into(staging, also)
        if not made.partial:
            after.callback(made.done)
    single = "TRC, C3D and the other formats" if more else "TRC and C3D"
    wrote([*made.files, *more], output, f"{single} hold the layer {made.layer}.")
    for remark in remarks:
        note(f"note: {remark}")
    if made.partial:
        warn(made.partial)
        sys.exit(130)


@dataclass(frozen=True)
class Made:
    """What was written of a recording.

    Attributes:
        files: their names.
        layer: that TRC and C3D hold.
        partial: what there is to say if it is not of the whole recording; empty if it is.
        done: to be called when the files are where they belong: what was kept to go on from is not needed any more.
    """

    files: list[str]
    layer: LayerName
    partial: str
    done: Callable[[], None]


@contextmanager
def told_of_parts(parts: Path) -> Iterator[None]:
    """Whoever interrupts is told what is kept."""
    try:
        yield
    except KeyboardInterrupt:
        if parts.exists():
            warn(f"Finished parts are kept in {parts}; the same command goes on from there.")
        raise


def reconstruct_into(
    folder: Path,
    recording: Path,
    calibration: Path | None,
    keypoints: Path | None,
    options: Options,
    edits: Path | None = None,
    timestamps: Path | None = None,
    parts: Path | None = None,
) -> Made:
    """Read, reconstruct, write into an existing folder, and say what came out.

    Args:
        folder: where.
        recording: its folder.
        calibration: where it is, if not in the recording's folder.
        keypoints: likewise.
        options: of the reconstruction.
        edits: to be applied to the result.
        timestamps: as the calibration.
        parts: folder for finished parts of a long recording, from which the same call goes on; none are kept otherwise.
    """
    progress = Bars()
    inputs = read_inputs(recording, calibration, keypoints, options, progress, timestamps)
    must_have_rate(inputs.detections)
    if options.skeleton is not None:
        # The result holds the whole skeleton; where its file lay is nobody's business.
        options = replace(options, skeleton=inputs.detections.skeleton.name)

    from posefuse.cli.edit import Done, write_edited
    from posefuse.io.results import netcdf
    from posefuse.pipeline.diagnose import with_health
    from posefuse.pipeline.reconstruct import prepare

    done = None if edits is None else Done.read(edits)
    checkpoint, forget = checkpoint_of(parts, inputs, options)

    def make(path: Path) -> "Plan":
        plan = with_health(prepare(inputs.rig, inputs.detections, options, progress, checkpoint))
        plan = replace(plan, provenance=replace(plan.provenance, inputs=inputs.digests))
        write_chunks(plan, progress, checkpoint, path)
        return plan

    path = folder / "reconstruction.nc"
    plan = write_once(checkpoint, path, make)
    if done is not None:
        path = path.rename(folder / "unedited.nc")
        write_edited(netcdf.read_reconstruction(path), done, folder / "reconstruction.nc")
        path.unlink()
    result = netcdf.read_reconstruction(folder / "reconstruction.nc")
    files, layer = write_beside(result, folder, progress)
    debug = [] if plan is None else write_debug(plan, result, folder, progress)
    return Made(["reconstruction.nc", *files, *debug], layer, partial_remark(result), forget)


def write_once(checkpoint: Checkpoint, path: Path, make: Callable[[Path], "Plan"]) -> "Plan | None":
    """Write ``reconstruction.nc`` unless it was kept; from then on it is kept instead of its parts.

    Args:
        checkpoint: of the parts.
        path: of the file.
        make: writes it; the plan of what it holds.

    Returns:
        The plan, None where the file had been kept: then it has no debug figures.
    """
    from posefuse.io.results import netcdf

    before = checkpoint.load_file(path)
    if before is not None:
        for remark in before:
            warnings.warn(remark, PosefuseWarning, stacklevel=2)
        return None
    said, show = [], warnings.showwarning

    def hear(remark: str) -> None:
        said.append(remark)
        show(PosefuseWarning(remark), PosefuseWarning, __file__, 0)

    with handle_warnings(hear):
        plan = make(path)
    if not (has_debug(plan) or partial_remark(netcdf.read_reconstruction(path))):
        checkpoint.save_file(path, tuple(said))
    return plan


def partial_remark(result: Reconstruction) -> str:
    """What a result says that is not of the whole recording; empty where it is."""
    from posefuse.pipeline.measured_layer import PARTIAL

    return next((remark for remark in result.provenance.notes if remark.startswith(PARTIAL)), "")


def write_chunks(plan: "Plan", progress: Bars, checkpoint: Checkpoint, path: Path) -> None:
    """Write the reconstruction; if that is interrupted and chunks are kept, those that are done."""
    from posefuse.io.results import netcdf
    from posefuse.pipeline.measured_layer import finished_chunks, reconstruct_chunks

    try:
        netcdf.write(reconstruct_chunks(plan, progress, checkpoint), path)
    except KeyboardInterrupt:
        progress.finish()
        if next(finished_chunks(plan, checkpoint), None) is None:
            raise
        warn("Interrupted: the result is made of what is done. Ctrl-C again stops at once.")
        netcdf.write(finished_chunks(plan, checkpoint), path)


def checkpoint_of(parts: Path | None, inputs: Inputs, options: Options) -> tuple[Checkpoint, Callable[[], None]]:
    """What keeps finished parts of a long recording, and what removes them; of a short one none are kept.

    Those of an earlier run with shorter chunks go.
    """
    short = inputs.detections.n_frames <= options.chunk_frames
    if parts is None or (short and not parts.exists()):
        return NO_CHECKPOINT, lambda: None
    checkpoint = parts_of(parts, inputs, options)
    return NO_CHECKPOINT if short else checkpoint, checkpoint.remove


def parts_of(parts: Path, inputs: Inputs, options: Options, window_s: float | None = None) -> "CheckpointFolder":
    """The finished parts in a folder, if they are of the same input, options and versions; it is said what is there.

    Args:
        parts: the folder.
        inputs: what was read.
        options: of the reconstruction.
        window_s: of the windows that the recording is divided into, if it is.
    """
    from posefuse.io.checkpoints import CheckpointFolder, digest_of
    from posefuse.io.netcdf import skeleton_text

    told = {
        "inputs": inputs.digests,
        "options": asdict(options),
        "skeleton": skeleton_text(inputs.detections.skeleton),
        "versions": {"python": python_version()}
        | {name: version(name) for name in ("posefuse", "numpy", "numba", "scipy")},
        "window_s": window_s,
    }
    checkpoint, others = CheckpointFolder.opened(parts, digest_of(told))
    if others:
        note(f"note: {parts} held {count(others, 'part')} of other input, options or versions; they are not used.")
    elif parts.exists():
        note(f"note: going on from the finished parts in {parts}.")
    return checkpoint


def write_beside(result: Reconstruction, folder: Path, progress: Bars) -> tuple[list[str], LayerName]:
    """Write all that stands beside ``reconstruction.nc``, and say what came out.

    Returns:
        The names of what was written, and the layer that TRC and C3D hold.
    """
    from posefuse.biomechanics.tables import angle_table, body_tables
    from posefuse.io.results.figures import write_figures
    from posefuse.io.results.write import people_with_frames, write_folder
    from posefuse.report.html import render_report

    files, layer = write_folder(result, folder, progress, angle_table, body_tables(result))
    figures, remarks = write_figures(result, people_with_frames(result), folder, progress)
    (folder / "report.html").write_text(render_report(result, progress=progress), "utf-8")
    describe(result)
    for remark in remarks:
        note(f"note: {remark}")
    return [*files, *figures, "report.html"], layer


def write_debug(plan: "Plan", result: Reconstruction, folder: Path, progress: Bars) -> list[str]:
    """Write the figures that show what a method did, for the methods that have one.

    Returns:
        The names of what was written.
    """
    if not has_debug(plan):
        return []
    from posefuse.evaluation.error_profile import error_profile
    from posefuse.pipeline.measured_layer import reconstruct_chunks
    from posefuse.pipeline.reconstruct import settle
    from posefuse.report.percentile_filter import percentile_filter_figure

    before = error_profile(reconstruct_chunks(settle(plan, "simple"), progress))
    picture = percentile_filter_figure(before, error_profile(result.chunks()), result)
    (folder / FILTER_FIGURE).parent.mkdir()
    (folder / FILTER_FIGURE).write_bytes(picture.png)
    return [FILTER_FIGURE]


def has_debug(plan: "Plan") -> bool:
    """Whether the method has figures that show what it did."""
    from posefuse.triangulation.registry import find_method

    triangulation = plan.options.triangulation
    figure = find_method(triangulation.method).debug_figure
    return figure is not None and figure.applies(plan.rig, triangulation)


def describe(result: Reconstruction) -> None:
    """Say what came out, in a few lines."""
    from posefuse.model.status import USED_CODES, PointStatus, ViewStatus
    from posefuse.report.summary import format_sources, summarize

    name, _ = result.best_layer(result.options.layer)
    summary = summarize(result.chunks(), name)
    there = sum(n for code, n in summary.status_counts.items() if code.has_point)
    rate = f" at {result.rate_hz:g} Hz" if result.rate_hz else ""
    say(
        f"{count(result.n_frames, 'frame')}{rate}, {count(len(result.rig), 'camera')}, "
        f"{count(len(result.skeleton), 'keypoint')}, method {result.options.triangulation.method}, "
        f"solved by {result.options.solve}"
    )
    for remark in result.provenance.notes:
        note(f"note: {remark}")
    if result.unit == "px":
        note("note: one camera: coordinates are px in its image plane, no place in the world; C3D cannot hold them.")
    whose = "" if len(result.person_ids) == 1 else " of people who are followed"
    share = there / summary.n_points if summary.n_points else math.nan
    say(f"{percent(share)} of the points{whose} have coordinates (layer {name})")
    if there:
        say(f"of these: {format_sources(summary.source_counts)}")
    if summary.error_px.count:
        say(f"reprojection error: median {summary.error_px.median:.2f} px, 90 % {summary.error_px.p90:.2f} px")
    missing = [(code, n) for code, n in summary.status_counts.items() if not code.has_point]
    for code, n in missing:
        say(f"missing: {n} points, {PointStatus(code).sentence}")
    if len(result.person_ids) != 1 or result.events:
        describe_people(result, name)
    if not there and summary.n_points:
        totals = zip(summary.view_status_counts.sum(axis=0), ViewStatus, strict=True)
        _, cause = max((int(n), code) for n, code in totals if code not in USED_CODES)
        warn(f"no point has coordinates. Most observations: {cause.sentence}.")
    swapped = summary.swapped
    rows = []
    for v, camera in enumerate(result.rig.names):
        error = summary.error_px_by_view[v]
        numbers = [f"{value:.2f}" if np.isfinite(value) else "-" for value in (error.median, error.p90)]
        swaps = [] if swapped is None else [percent(summary.swapped_share(v))]
        rows.append([camera, percent(summary.used[v]) if summary.n_points else "-", *numbers, *swaps])
    table(None, ["camera", "used", "median px", "90 % px", *([] if swapped is None else ["sides swapped"])], rows)


def describe_people(result: Reconstruction, layer: LayerName) -> None:
    """Say who was there when, and what happened to them."""
    from posefuse.io.results.write import people_with_frames
    from posefuse.model.tracks import TrackState
    from posefuse.report.people import format_event_counts, presence_interval, summarize_people

    if not result.person_ids:
        warn("nobody was found.")
    elif not people_with_frames(result):
        warn("nobody is left in any frame; there is no TRC or C3D to write.")
    if result.events:
        note(f"events: {format_event_counts(result.events)}")
    uncertain = [
        event
        for event in result.events
        if event.what in ("possible_identity_switch", "camera_rejected", "camera_silent")
    ]
    for event in uncertain:
        note(f"frame {event.number}: {event.person}: {event.what}: {event.why}")
    everybody = summarize_people(result.chunks(), layer)
    if not everybody:
        return
    timed = bool(np.isfinite(result.time_s).all())
    rows = []
    for life in everybody:
        span = max(life.last - life.first + 1, 1)
        shares = [percent(life.frames[state] / span) for state in (TrackState.ACTIVE, TrackState.LOST)]
        numbers = [f"{value:.1f}" if np.isfinite(value) else "-" for value in (life.n_views, life.error_px)]
        rows.append([life.name, *presence_interval(result, life), *shares, *numbers])
    unit = "s" if timed else "frame"
    table(None, ["person", f"from {unit}", f"to {unit}", "active", "lost", "cameras", "median px"], rows)
