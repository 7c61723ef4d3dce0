"""From a folder of videos to a report: detect, calibrate, synchronize, reconstruct."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from posefuse.arguments import checked
from posefuse.calibration.outcome import Refinement
from posefuse.errors import OutputExistsError, RecordingError
from posefuse.io.calibration.read import read_cameras
from posefuse.io.files import RUN_FILE, check_folder_marker, replacing, writable
from posefuse.io.folder_locks import exclusive_folder
from posefuse.io.open_recording import RecordingInputs, digest_path
from posefuse.io.options import read_sync
from posefuse.io.project import PROJECT_FILE, project_to_toml
from posefuse.io.recording import LENSES_FILE
from posefuse.model.options.options import Options
from posefuse.model.options.run import RunOptions
from posefuse.model.options.sync import SyncOptions
from posefuse.model.reconstruction import Reconstruction
from posefuse.parallel import JobCount, number_of_jobs
from posefuse.pipeline.contact_sheet import write_contact_sheet
from posefuse.pipeline.detect import DetectionOutcome, Given, detect_videos
from posefuse.pipeline.distributed import is_long
from posefuse.pipeline.fingerprints import RESULT as RECONSTRUCTION
from posefuse.pipeline.reconstruct_recording import Execution, Outcome, Request, carry_out
from posefuse.pipeline.report_videos import write_report
from posefuse.pipeline.run.calibrate_stage import (
    Calibrated,
    calibrate_board,
    calibrate_people,
    calibration_inputs,
    refine,
)
from posefuse.pipeline.run.inputs import compare_inputs, with_inputs
from posefuse.pipeline.run.lens_stage import Lenses, calibrate_lenses, lens_inputs
from posefuse.pipeline.run.people_in_videos import PeopleInVideos
from posefuse.pipeline.run.plan import CALIBRATION, KEYPOINTS, PEOPLE, REPORT, RESULT, SYNC, RunPlan, make_plan
from posefuse.pipeline.run.state import RunState, stage_key
from posefuse.pipeline.run.sync_stage import Synchronized, known_starts, measure, write_sync
from posefuse.progress import Progress, Silent


@checked
@dataclass(frozen=True, eq=False)
class RunOutcome:
    """The outcome of :func:`run`.

    Attributes:
        output: folder of the run.
        plan: what was planned.
        detection: what was found in the videos; None if keypoints were given or it was planned only.
        lenses: lenses by a board that each camera sees alone; None if there are no such images, or they had been used
            before.
        calibration: the calibration that was made; None if it was given, or had been made before.
        refinement: the adjustment of a given calibration; None if it was not asked for, or had been made before.
        synchronization: the clocks; None if they were not measured, or had been measured before.
        reconstruction: outcome of the reconstruction; None if the run was planned only, or left a long recording to the
            caller (``execution``).
        report: report with the videos; None if there are no videos, or it had been written before.
        contact_sheet: page with pictures of the people; None for a single person who was not chosen among several.
        kept: stages that an earlier run had finished with the same inputs and options.
    """

    output: Path
    plan: RunPlan
    detection: DetectionOutcome | None = None
    lenses: Lenses | None = None
    calibration: Calibrated | None = None
    refinement: Refinement | None = None
    synchronization: Synchronized | None = None
    reconstruction: Outcome | None = None
    report: Path | None = None
    contact_sheet: Path | None = None
    kept: tuple[str, ...] = ()


@dataclass(frozen=True)
class Watcher:
    """Receives what a run does, as it does it, and says how many processes it may use.

    Attributes:
        planned: called with the plan before any work is done.
        finished: called after each stage with its name and the outcome so far.
        progress: receives the progress.
        jobs: number of processes of the reconstruction, see :func:`reconstruct_recording`, and of detectors and threads
            that search boards, unless their options name another; "auto" starts one of these per core. No file depends
            on it.
    """

    planned: Callable[[RunPlan], None] = lambda _: None
    finished: Callable[[str, RunOutcome], None] = lambda _, __: None
    progress: Progress = field(default_factory=Silent)
    jobs: JobCount = "auto"


@checked
def run(
    folder: str | Path,
    output: str | Path,
    run: RunOptions | None = None,
    options: Options | None = None,
    *,
    detector: Any = None,
    skeleton: Any = None,
    also: tuple[str, ...] = (),
    watcher: Watcher | None = None,
) -> RunOutcome:
    """Reconstruct the people in the videos of a folder: detect, calibrate, synchronize, reconstruct, report.

    Each stage writes its files into ``output``: ``keypoints``, ``calibration.toml``, ``sync.toml``, ``result`` and
    ``report.html``. The same call resumes after an interruption, and repeats a stage only if its inputs or options
    changed. The file ``posefuse.toml`` holds every choice that was made; :func:`read_run` reads it.

    Args:
        folder: folder with the videos of all cameras, and what is known of them: a calibration, videos of a board, 2D
            keypoints, timestamps.
        output: folder for all files; created if absent.
        run: options of detection, calibration and synchronization.
        options: options of the reconstruction.
        detector: a function of one image, as in :func:`detect`; by default that of the options.
        skeleton: skeleton of the keypoints that a function returns.
        also: further formats of the result, see ``posefuse formats``.
        watcher: receives the plan and the progress, and holds the number of processes.

    Returns:
        What was done in each stage.

    Raises:
        OptionsError: if ``jobs`` is less than 1.
        FileError: if the output contains other files.
        RecordingError: if something is missing; one message names all of it, and what to do.
        PosefuseError: if a stage fails; the stages before it are kept.
    """
    watcher = watcher or Watcher()

    def plan() -> RunPlan:
        return plan_run(folder, run, options, detector=detector, skeleton=skeleton)

    return _carry_out(plan, Path(output), also, watcher, Execution(watcher.jobs))


def run_in_batch(
    folder: Path, output: Path, run: RunOptions, options: Options, watcher: Watcher, execution: Execution
) -> RunOutcome:
    """Do what :func:`run` does, with the same errors, for a batch that determines how it is executed."""
    return _carry_out(lambda: plan_run(folder, run, options), output, (), watcher, execution)


def _carry_out(
    make_plan: Callable[[], RunPlan], output: Path, also: tuple[str, ...], watcher: Watcher, execution: Execution
) -> RunOutcome:
    """Plan a run, and run all stages."""
    number_of_jobs(execution.jobs, useful=1)
    check_folder_marker(output, RUN_FILE)
    plan = make_plan()
    if plan.is_empty:
        raise RecordingError(plan.problems[0])
    watcher.planned(plan)
    if plan.problems:
        raise RecordingError("\n".join(plan.problems))
    plan = replace(plan, choices=with_inputs(plan))
    with writable(output):
        output.mkdir(parents=True, exist_ok=True)
    with exclusive_folder(output, output):
        state = RunState.read(output)
        state.write()
        with replacing(output / PROJECT_FILE) as temporary:
            temporary.write_text(project_to_toml(plan.choices, plan.options), "utf-8")
        plan = _with_jobs(plan, execution.jobs)
        return _Run(plan, RunOutcome(output, plan), state, watcher, execution).all(also)


def _with_jobs(plan: RunPlan, jobs: JobCount) -> RunPlan:
    """Return the plan with a number of detectors, threads and processes, where its options name none."""
    if jobs == "auto":
        return plan
    run = plan.choices
    detect = replace(run.detect, jobs=run.detect.jobs or jobs)
    by_board = replace(run.by_board, jobs=run.by_board.jobs or jobs)
    by_people = replace(run.by_people, jobs=run.by_people.jobs or jobs)
    return replace(plan, choices=replace(run, detect=detect, by_board=by_board, by_people=by_people))


@checked
def plan_run(
    folder: str | Path,
    run: RunOptions | None = None,
    options: Options | None = None,
    *,
    detector: Any = None,
    skeleton: Any = None,
) -> RunPlan:
    """Return what :func:`run` would do with a folder; arguments and errors as there.

    What is missing is in :attr:`RunPlan.problems`.
    """
    run = run or RunOptions()
    plan = make_plan(Path(folder), run, options or Options(), detector=detector, skeleton=skeleton)
    return replace(plan, notes=(*plan.notes, *compare_inputs(plan, run)))


class _Run:
    """One run: its stages share keypoints and evidence."""

    def __init__(
        self, plan: RunPlan, outcome: RunOutcome, state: RunState, watcher: Watcher, execution: Execution
    ) -> None:
        self.plan, self.outcome, self.state, self.watcher = plan, outcome, state, watcher
        self.output, self.progress, self.execution = outcome.output, watcher.progress, execution

    def all(self, also: tuple[str, ...]) -> RunOutcome:
        """Run all stages."""
        keypoints = self._detect()
        run = self.plan.choices
        timestamps = None if run.timestamps is None else self.plan.path(run.timestamps)
        people = PeopleInVideos(self.plan, keypoints, timestamps, self.progress)
        calibration = self._calibrate(people)
        sync = self._synchronize(people, calibration)
        leave_s = self.execution.leave_s
        if leave_s is not None and is_long(people.detections(), self.plan.options, leave_s):
            return self.outcome
        inputs = RecordingInputs(calibration, keypoints, timestamps)
        self._finish("reconstruct", reconstruction=self._reconstruct(inputs, sync, also))
        if any(stage.name == "report" for stage in self.plan.stages):
            self._report()
            self._contact_sheet()
        return self.outcome

    def _finish(self, stage: str, *, kept: bool = False, **found: Any) -> None:
        """Add what a stage found to the outcome, and report it."""
        names = (*self.outcome.kept, stage) if kept else self.outcome.kept
        self.outcome = replace(self.outcome, kept=names, **found)
        self.watcher.finished(stage, self.outcome)

    def _detect(self) -> Path:
        """Return the keypoints."""
        plan, run = self.plan, self.plan.choices
        if run.keypoints is not None:
            return plan.path(run.keypoints)
        videos = {name: plan.path(file) for name, file in run.files_of_views.items()}
        folder, given = self.output / KEYPOINTS, Given(plan.detector, plan.skeleton)
        options = run.detect
        try:
            found = detect_videos(videos, folder, options, given, progress=self.progress)
        except OutputExistsError:
            found = detect_videos(videos, folder, options, given, overwrite=True, progress=self.progress)
        _require_people(found)
        self._finish("detect", kept=found.n_images == 0, detection=found)
        return found.keypoints

    def _calibrate(self, people: PeopleInVideos) -> Path | None:
        """Return the calibration."""
        plan, way, given = self.plan, self.plan.choices.calibration, self.plan.choices.calibration_file
        if given is not None or way == "none":
            path = None if given is None else plan.path(given)
            return self._refine(path, people) if path is not None and plan.choices.refine else path
        path, values = self.output / CALIBRATION, calibration_inputs(plan)
        if way == "people":
            values |= people.digests() | {"videos": plan.choices.inputs.sha256}
        key = stage_key(values)
        if path.is_file() and self.state.is_finished("calibrate", key):
            self._finish("calibrate", kept=True)
            return path
        lenses = self._lenses()
        if way == "board":
            made = calibrate_board(plan, lenses, path, self.progress)
        else:
            starts = known_starts(plan, people.sound())
            made = calibrate_people(plan, people.detections(), starts, lenses, path, self.progress)
        self.state.finish("calibrate", key)
        self._finish("calibrate", calibration=made)
        return path

    def _lenses(self) -> Path | None:
        """Return the file of known lenses, if any."""
        plan = self.plan
        if not plan.lens_views:
            return None if plan.choices.intrinsics is None else plan.path(plan.choices.intrinsics)
        path, key = self.output / LENSES_FILE, stage_key(lens_inputs(plan))
        if not (path.is_file() and self.state.is_finished("lenses", key)):
            found = calibrate_lenses(plan, path, self.progress)
            self.state.finish("lenses", key)
            self._finish("lenses", lenses=found)
        return path

    def _refine(self, given: Path, people: PeopleInVideos) -> Path:
        """Return the refined calibration, or the given one if it is not worse."""
        path = self.output / CALIBRATION
        key = stage_key({"refine": digest_path(given), "options": asdict(self.plan.options)} | people.digests())
        if self.state.is_finished("calibrate", key):
            self._finish("calibrate", kept=True)
        elif people.detections().n_views > 1:
            found = refine(self.plan, given, people.detections(), path, self.progress)
            self.state.finish("calibrate", key)
            self._finish("calibrate", refinement=found)
        return path if path.is_file() else given

    def _synchronize(self, people: PeopleInVideos, calibration: Path | None) -> SyncOptions:
        """Return the time offsets of the views."""
        plan, run = self.plan, self.plan.choices
        if run.sync_file is not None:
            return read_sync(plan.path(run.sync_file))
        if run.synchronize == "off" or calibration is None:
            return SyncOptions()
        path = self.output / SYNC
        values = {"calibration": digest_path(calibration), "options": asdict(plan.options)}
        key = stage_key(values | people.digests() | {"videos": run.inputs.sha256, "max_offset_s": run.max_offset_s})
        if path.is_file() and self.state.is_finished("synchronize", key):
            self._finish("synchronize", kept=True)
            return read_sync(path)
        detections = people.detections()
        if detections.n_views < 2:
            return SyncOptions()
        rig = read_cameras(calibration, length_unit=plan.options.length_unit, up=plan.options.up)
        found = measure(plan, rig, detections, people.sound(), self.progress)
        write_sync(found.sync, path)
        self.state.finish("synchronize", key)
        self._finish("synchronize", synchronization=found)
        return read_sync(path)

    def _reconstruct(self, inputs: RecordingInputs, sync: SyncOptions, also: tuple[str, ...]) -> Outcome:
        """Return the outcome of the reconstruction."""
        plan = self.plan
        options = plan.options if sync.does_nothing else replace(plan.options, sync=sync)
        request = Request(plan.session.folder, self.output / RESULT, options, inputs, also)
        try:
            return carry_out(request, self.progress, self.execution)
        except OutputExistsError:
            return carry_out(replace(request, overwrite=True), self.progress, self.execution)

    def _report(self) -> None:
        """Write the report with the videos."""
        path, (result, key) = self.output / REPORT, self._result()
        if path.is_file() and self.state.is_finished("report", key):
            self._finish("report", kept=True)
            return
        name = self.plan.session.folder.resolve().name
        videos = self._videos_of(result)
        write_report(result, path, videos=videos, recording=name, overwrite=True, progress=self.progress)
        self.state.finish("report", key)
        self._finish("report", report=path)

    def _contact_sheet(self) -> None:
        """Write pictures of the people, where there is a choice between them."""
        path, (result, key) = self.output / PEOPLE, self._result()
        if not result.has_identities or (len(result.person_ids) < 2 and result.options.people != "one"):
            path.unlink(missing_ok=True)
            return
        if not (path.is_file() and self.state.is_finished("people", key)):
            write_contact_sheet(result, path, videos=self._videos_of(result), overwrite=True, progress=self.progress)
            self.state.finish("people", key)
        self._finish("people", contact_sheet=path)

    def _result(self) -> tuple[Reconstruction, str]:
        """Return the result, and a digest of it and of the videos."""
        made = self.outcome.reconstruction
        assert made is not None
        digest = digest_path(made.output / RECONSTRUCTION)
        return made.open(), stage_key({"result": digest, "videos": self.plan.choices.inputs.sha256})

    def _videos_of(self, result: Reconstruction) -> dict[str, Path]:
        """Return the videos of a result's cameras."""
        files, views = self.plan.choices.files_of_views, self.plan.images_of(result.rig.names)
        return {name: self.plan.path(files[view.name]) for name, view in views.items()}


def _require_people(found: DetectionOutcome) -> None:
    """Refuse videos without people.

    Raises:
        RecordingError: if no view, or only one of several, shows a person.
    """
    seen = [view.name for view in found.views if view.n_with_people]
    if found.views and not seen:
        raise RecordingError(
            f"{found.detector} found no person in any of the {len(found.views)} videos. Do they show people, large "
            "enough and lit? `detector` names another detector, `detect.crop` a part of the images."
        )
    if len(found.views) > 1 and len(seen) == 1:
        raise RecordingError(
            f"{found.detector} found people in the video of {seen[0]!r} only; two views are needed. "
            "`detector` names another detector, `detect.crop` a part of the images."
        )
