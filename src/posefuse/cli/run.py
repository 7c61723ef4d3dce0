"""``posefuse run``."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from posefuse.cli.console import Bars, count, labeled, notes, say, table, warn, wrote
from posefuse.cli.describe_result import describe_gait, describe_remarks, describe_result, layer_remark
from posefuse.cli.findings import AcceptFindings, exit_on_certain_faults
from posefuse.cli.help import RECONSTRUCTION_GROUP
from posefuse.cli.types import Also, JobsFlag, Output
from posefuse.errors import choices
from posefuse.model.options.options import Options
from posefuse.model.options.run import RunOptions

if TYPE_CHECKING:
    from posefuse.pipeline.run.plan import RunPlan
    from posefuse.pipeline.run.recipe import RunOutcome


@dataclass(frozen=True)
class Shortcuts:
    """Short flags for frequently used options."""

    detector: Annotated[
        str | None,
        Parameter(help="Detector (posefuse detector list) or worker file; by default the best one that can run now."),
    ] = None
    weights: Annotated[tuple[Path, ...], Parameter(help="Files of the detector's weights.")] = ()
    stature_m: Annotated[
        float | None, Parameter(help="Standing height of the tallest person, for a calibration by people.")
    ] = None

    def applied_to(self, run: RunOptions) -> RunOptions:
        """Return the options with the values of the short flags."""
        if self.detector is not None:
            run = replace(run, detect=replace(run.detect, detector=self.detector))
        if self.weights:
            run = replace(run, detect=replace(run.detect, weights=tuple(str(file.resolve()) for file in self.weights)))
        if self.stature_m is not None:
            run = replace(run, by_people=replace(run.by_people, stature_m=self.stature_m))
        return run


@dataclass(frozen=True)
class _Behavior:
    """Flags of what is written, of the exit code, and of how it runs."""

    dry_run: Annotated[bool, Parameter(negative="", help="Print the plan only.")] = False
    also: Also = ()
    accept_findings: AcceptFindings = False
    jobs: JobsFlag = "auto"


def run(
    folder: Annotated[Path, Parameter(help="Folder with the videos of all cameras.")],
    *,
    output: Output,
    shortcuts: Annotated[Shortcuts, Parameter(name="*")] = Shortcuts(),
    run: Annotated[RunOptions, Parameter(name="*")] = RunOptions(),  # noqa: B008
    behavior: Annotated[_Behavior, Parameter(name="*")] = _Behavior(),
    options: Annotated[Options, Parameter(name="*", group=Group(RECONSTRUCTION_GROUP, sort_key=2))] = Options(),  # noqa: B008
) -> None:
    """Reconstruct the people in the videos of a folder: detect, calibrate, synchronize, reconstruct, report.

    What the folder contains decides what is done: 2D keypoints, a calibration, images of a board and timestamps are
    used where they exist. The plan is printed first.

    OUTPUT holds the files of every stage: keypoints, calibration.toml, sync.toml, result, report.html, people.html.
    The same command resumes after an interruption, and repeats a stage only if its inputs or options changed. The file
    OUTPUT/posefuse.toml holds every choice; run FOLDER --options posefuse.toml gives the same bytes.

    The exit code is 3 if the recording check is certain that the result is wrong; --accept-findings makes it 0.
    """
    from posefuse.pipeline.run.recipe import Watcher, plan_run
    from posefuse.pipeline.run.recipe import run as run_recording

    run = shortcuts.applied_to(run)
    if behavior.dry_run:
        plan = plan_run(folder, run, options)
        if not plan.is_empty:
            _say_plan(plan)
        for problem in plan.problems:
            warn(problem)
        if plan.problems:
            sys.exit(1)
        return
    watcher = Watcher(_say_plan, _Stages(options, behavior), Bars("images", "detecting"), behavior.jobs)
    outcome = run_recording(folder, output, run, options, also=behavior.also, watcher=watcher)
    assert outcome.reconstruction is not None
    report = output / "report.html"
    say("")
    say(f"Report: {report if report.exists() else outcome.reconstruction.output / 'report.html'}")
    if outcome.contact_sheet is not None:
        say(f"People, with the names for --person: {outcome.contact_sheet}")
    if outcome.reconstruction.partial:
        warn(outcome.reconstruction.partial)
        sys.exit(130)
    exit_on_certain_faults(outcome.reconstruction.findings, behavior.accept_findings, "the result is")


def _say_plan(plan: "RunPlan") -> None:
    """Print what the folder contains and what is done with it."""
    from posefuse.pipeline.run.view_facts import describe_views

    if plan.views:
        names = ", ".join(view.name for view in plan.views)
        what = "video" if plan.views[0].is_video else "folder of pictures"
        labeled("views", f"{count(len(plan.views), what)}: {names}; {describe_views(plan.views)}")
    for stage in plan.stages:
        labeled(stage.name, stage.text + (f" -> {stage.output}" if stage.output else ""))
    notes(plan.notes)


class _Stages:
    """Prints what each stage found."""

    def __init__(self, options: Options, behavior: _Behavior) -> None:
        self.options, self.behavior = options, behavior

    def __call__(self, stage: str, outcome: "RunOutcome") -> None:
        """Print the result of a stage."""
        if stage in ("report", "people"):
            return
        say("")
        if stage in outcome.kept and stage != "reconstruct":
            labeled(stage, "kept: inputs and options did not change")
            return
        {
            "detect": self._detection,
            "lenses": self._lenses,
            "calibrate": self._calibration,
            "synchronize": self._synchronization,
            "reconstruct": self._reconstruction,
        }[stage](outcome)

    def _detection(self, outcome: "RunOutcome") -> None:
        from posefuse.cli.detect import describe

        assert outcome.detection is not None
        labeled("detect", f"by {outcome.detection.detector}")
        describe(outcome.detection)

    def _lenses(self, outcome: "RunOutcome") -> None:
        found = outcome.lenses
        assert found is not None
        names = ", ".join(f"{name} ({n} images)" for name, n in zip(found.rig.names, found.n_images, strict=True))
        labeled("lenses", names)
        for reason in found.left_out.values():
            warn(f"left out: {reason}")

    def _calibration(self, outcome: "RunOutcome") -> None:
        refined = outcome.refinement
        if refined is not None:
            from posefuse.cli.refine_calibration import NOT_SHOWN
            from posefuse.cli.refine_calibration import describe as describe_refinement

            used = "predicts held-out frames better and is used" if refined.predicts_better else "is not used"
            labeled("calibrate", f"the refined calibration {used}")
            describe_refinement(refined)
            if refined.predicts_better and not refined.is_better:
                warn(f"The refined calibration is used because of `refine`, but {NOT_SHOWN}")
            return
        assert outcome.calibration is not None
        page = outcome.output / "calibration.html"
        labeled("calibrate", outcome.calibration.sentence + (f" Report: {page}" if page.exists() else ""))
        for name, reason in outcome.calibration.left_out.items():
            warn(f"left out: camera {name!r}: {reason}")

    def _synchronization(self, outcome: "RunOutcome") -> None:
        found = outcome.synchronization
        assert found is not None
        if found.note or found.found is None:
            labeled("synchronize", found.note)
            return
        unknown = found.found.unknown
        if found.sync.does_nothing:
            labeled(
                "synchronize",
                f"no time offset to correct; unknown for {choices(unknown)}"
                if unknown
                else "the views are synchronized",
            )
        else:
            labeled("synchronize", f"{count(len(set(found.sync.cameras)), 'view')} corrected")
            rows = [
                [name, f"{offset:+.3f}", f"{drift:+.0f}" if drift else "-"]
                for name, offset, drift in zip(
                    found.sync.cameras, found.sync.offset_s, found.sync.drift_ppm, strict=True
                )
            ]
            table(None, ["camera", "late, s", "drift ppm"], rows)
        for sentence in found.found.contradictions:
            warn(sentence)

    def _reconstruction(self, outcome: "RunOutcome") -> None:
        made = outcome.reconstruction
        assert made is not None
        if made.kept:
            labeled("reconstruct", "kept: inputs and options did not change")
            return
        labeled("reconstruct", "")
        describe_result(made.open())
        describe_gait(made.gait)
        describe_remarks(made.remarks)
        wrote(made.files, made.output, layer_remark(made.files, made.layer, self.behavior.also))
