"""Calibrate the cameras of a run, by a board or by the people in its videos."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from posefuse.calibration.assessment import assess
from posefuse.calibration.boards.summary import summarize_board
from posefuse.calibration.outcome import Refinement
from posefuse.calibration.people.result import PeopleCalibration
from posefuse.calibration.people.summary import summarize_people
from posefuse.errors import CalibrationError, DetectionsError
from posefuse.io.calibration import anipose
from posefuse.io.calibration.read import read_cameras
from posefuse.io.files import replacing
from posefuse.io.open_recording import digest_path
from posefuse.model.calibration_summary import CalibrationSummary
from posefuse.model.detections import Detections
from posefuse.model.options.calibration import PeopleOptions
from posefuse.model.options.refinement import RefineOptions
from posefuse.model.options.sync import SyncOptions
from posefuse.pipeline.calibrate_board import calibrate_by_board
from posefuse.pipeline.calibrate_people import calibrate_by_people
from posefuse.pipeline.calibration_report import write_calibration_report
from posefuse.pipeline.refine_recording import refine_by_keypoints
from posefuse.pipeline.run.lens_stage import board_digest, board_of, lens_inputs
from posefuse.pipeline.run.plan import RunPlan
from posefuse.pipeline.run.view_facts import shortest_s
from posefuse.preprocess.start_times import with_start_times
from posefuse.progress import Progress

_NEAR_S = 2.0
"""Bound of the time offsets that are tried first: large ones are found by chance more easily."""
_OVERLAP = 0.5
"""Least share of the shortest video that another one must overlap with."""


@dataclass(frozen=True)
class Calibrated:
    """A calibration that a run made.

    Attributes:
        summary: error and verdict.
        left_out: cameras that could not be calibrated, with the reason.
    """

    summary: CalibrationSummary
    left_out: Mapping[str, str]

    @property
    def sentence(self) -> str:
        """The verdict."""
        return assess(self.summary).sentence


def calibration_inputs(plan: RunPlan) -> dict[str, Any]:
    """Return what a calibration depends on beside keypoints and their times, as JSON values."""
    run = plan.choices
    values: dict[str, Any] = {"way": run.calibration, "intrinsics": _digest(plan, run.intrinsics)}
    if plan.lens_views:
        values["lenses"] = lens_inputs(plan)
    if run.calibration == "board":
        assert run.board_images is not None
        assert run.board is not None
        values |= {
            "board": board_digest(plan),
            "images": [digest_path(file) for view in plan.board_views for file in view.files],
            "options": asdict(replace(run.by_board, jobs=None)),
        }
        return values
    return values | {"options": asdict(replace(run.by_people, jobs=None)), "max_offset_s": run.max_offset_s}


def _digest(plan: RunPlan, text: str | None) -> str:
    return "" if text is None else digest_path(plan.path(text))


def calibrate_board(plan: RunPlan, lenses: Path | None, output: Path, progress: Progress) -> Calibrated:
    """Calibrate by a board and write the calibration with its report.

    Args:
        plan: the plan.
        lenses: calibration file with known lenses, or None.
        output: calibration file to write.
        progress: receives the progress.

    Raises:
        CalibrationError: if the images do not determine the cameras.
    """
    run = plan.choices
    assert run.board is not None
    assert run.board_images is not None
    result = calibrate_by_board(
        plan.board_views,
        board_of(plan),
        intrinsics=lenses,
        options=run.by_board,
        progress=progress,
    )
    calibrated = Calibrated(summarize_board(result), {})
    _write(calibrated, result.rig, output, run.board_images)
    return calibrated


def calibrate_people(
    plan: RunPlan,
    detections: Detections,
    starts: Sequence[SyncOptions],
    lenses: Path | None,
    output: Path,
    progress: Progress,
) -> Calibrated:
    """Calibrate by people and write the calibration with its report.

    Args:
        plan: the plan.
        detections: keypoints of the people.
        starts: start times of the views, each tried if the people do not determine the cameras with those before.
        lenses: calibration file with known lenses, or None.
        output: calibration file to write.
        progress: receives the progress.

    Raises:
        CalibrationError: if the people do not determine the cameras.
    """
    run = plan.choices
    options = replace(
        run.by_people,
        skeleton=None,
        rate_hz=run.by_people.rate_hz or plan.options.rate_hz,
        view_rates_hz=run.by_people.view_rates_hz or plan.options.view_rates_hz,
        image_size=run.by_people.image_size or plan.options.image_size,
    )
    sizes = {name: view.size_px for name, view in plan.images_of(detections.view_names).items()}
    widest_s = min(run.max_offset_s, _OVERLAP * shortest_s(plan.views))

    def calibrate(start: SyncOptions, chosen: PeopleOptions) -> PeopleCalibration:
        shifted = with_start_times(detections, start)
        return calibrate_by_people(shifted, intrinsics=lenses, image_sizes=sizes, options=chosen, progress=progress)

    for start in starts[:-1]:
        with contextlib.suppress(CalibrationError, DetectionsError):
            result = _with_widening_offsets(partial(calibrate, start), options, widest_s, run.max_offset_s)
            break
    else:
        result = _with_widening_offsets(partial(calibrate, starts[-1]), options, widest_s, run.max_offset_s)
    calibrated = Calibrated(summarize_people(result), result.left_out)
    _write(calibrated, result.rig, output, "the people")
    return calibrated


def refine(plan: RunPlan, calibration: Path, detections: Detections, output: Path, progress: Progress) -> Refinement:
    """Refine a given calibration, and write it if it predicts held-out frames better.

    Args:
        plan: the plan.
        calibration: the given calibration.
        detections: keypoints of the people.
        output: calibration file to write; it is removed if the given one is to be kept.
        progress: receives the progress.

    Raises:
        CalibrationError: if the people do not determine the cameras.
    """
    rig = read_cameras(calibration, length_unit=plan.options.length_unit, up=plan.options.up)
    refining = RefineOptions(jobs=plan.choices.by_people.jobs)
    result = refine_by_keypoints(rig, detections, plan.options, refining, progress)
    output.unlink(missing_ok=True)
    if result.predicts_better:
        notes = (
            f"Refined by the people from {calibration.name} (SHA-256 {digest_path(calibration)}).",
            f"Median error in held-out frames: {result.before_px:.2f} px before, {result.after_px:.2f} px after.",
        )
        with replacing(output) as temporary:
            anipose.write(replace(result.rig, notes=notes, left_out=result.left_out), temporary)
    return result


def _with_widening_offsets(calibrate: Any, options: PeopleOptions, widest_s: float, most_s: float) -> PeopleCalibration:
    """Calibrate with views that start at about the same time, and if that fails, with views that do not.

    Args:
        calibrate: calibrates with given options.
        options: of the calibration.
        widest_s: largest offset at which the videos overlap enough.
        most_s: largest offset that the user allows.
    """
    near = replace(options, max_offset_s=min(options.max_offset_s, max(widest_s, 0.0)))
    wide = replace(options, max_offset_s=min(max(options.max_offset_s, widest_s), most_s))
    try:
        first = calibrate(near)
    except CalibrationError:
        if wide.max_offset_s <= near.max_offset_s:
            raise
        return calibrate(wide)
    if not first.left_out or wide.max_offset_s <= near.max_offset_s:
        return first
    try:
        second = calibrate(wide)
    except CalibrationError:
        return first
    return second if len(second.left_out) < len(first.left_out) else first


def _write(calibrated: Calibrated, rig: Any, output: Path, source: str) -> None:
    """Write the calibration after its report, so that a failure leaves no calibration.

    Raises:
        CalibrationError: if the calibration must not be used.
    """
    write_calibration_report(calibrated.summary, output.with_suffix(".html"))
    assessment = assess(calibrated.summary)
    if assessment.level == "bad":
        advice = assessment.advice[0].remedy if assessment.advice else ""
        raise CalibrationError(
            f"Calibration by {source}: {assessment.sentence} {advice} See {output.with_suffix('.html')}.".replace(
                "  ", " "
            )
        )
    with replacing(output) as temporary:
        anipose.write(rig, temporary)
