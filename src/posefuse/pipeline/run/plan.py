"""Plan a run: what a folder contains, what is done with it, and what is missing."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from posefuse.detection.boards.library import import_opencv
from posefuse.detection.environments import installed_python
from posefuse.detection.open import default_detector
from posefuse.detection.registry import find_detector
from posefuse.errors import PosefuseError, RecordingError, choices
from posefuse.io.board_images import ViewImages
from posefuse.io.board_specs import EXAMPLE
from posefuse.io.calibration.read import read_cameras
from posefuse.io.recording import choose_calibration, choose_keypoints
from posefuse.io.results.open_result import RESULT_OF_RUN
from posefuse.io.session import Session, find_session, locate, place_of, relative
from posefuse.io.timestamps import read_timestamps
from posefuse.io.videos.library import import_pyav
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import Options
from posefuse.model.options.run import RunOptions
from posefuse.model.view_names import matching_name
from posefuse.pipeline.run.board_choice import BoardChoice, choose_board, is_of_board
from posefuse.pipeline.run.view_facts import ViewFacts, check_sizes, examine_views
from posefuse.preprocess.match_cameras import check_names

KEYPOINTS, CALIBRATION, SYNC, RESULT, REPORT = (
    "keypoints",
    "calibration.toml",
    "sync.toml",
    RESULT_OF_RUN,
    "report.html",
)
PEOPLE = "people.html"
"""Names of what the stages write into the output."""


@dataclass(frozen=True)
class PlannedStage:
    """A stage of a run.

    Attributes:
        name: detect, calibrate, synchronize, reconstruct or report.
        text: what it does, in a few words.
        output: name of what it writes in the output folder; empty if there is nothing to do.
    """

    name: str
    text: str
    output: str = ""


@dataclass(frozen=True)
class RunPlan:
    """What a run does.

    Attributes:
        session: the content of the folder.
        choices: options of the run in which nothing is left to choose.
        options: options of the reconstruction.
        views: facts on the images of the views; empty without videos.
        stages: the stages in order.
        notes: what the user may not expect, such as files that are not used.
        problems: what is missing, each with what to do; a run with problems does not start.
        detector: a detector given in Python, or None.
        skeleton: skeleton of the keypoints that a function returns, or None.
        board_views: images of the board to calibrate by.
        lens_views: images of the board by single cameras, for their lenses.
    """

    session: Session
    choices: RunOptions
    options: Options
    views: tuple[ViewFacts, ...]
    stages: tuple[PlannedStage, ...]
    notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    detector: Any = None
    skeleton: Any = None
    board_views: tuple[ViewImages, ...] = ()
    lens_views: tuple[ViewImages, ...] = ()

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to reconstruct."""
        return not (self.views or self.session.views or self.choices.keypoints or self.session.recording.keypoints)

    def path(self, text: str) -> Path:
        """Return the path of an option."""
        return locate(text, self.session.folder)

    def images_of(self, names: Sequence[str]) -> dict[str, ViewFacts]:
        """Return the facts on the images of views by the names that the views have in keypoints."""
        matched = {matching_name(view.name, names): view for view in self.views}
        return {name: view for name, view in matched.items() if name is not None}


def make_plan(
    folder: Path, run: RunOptions, options: Options, *, detector: Any = None, skeleton: Any = None
) -> RunPlan:
    """Plan a run.

    Args:
        folder: folder of the recording.
        run: options as requested.
        options: options of the reconstruction.
        detector: a detector given in Python, or None.
        skeleton: skeleton of the keypoints that a function returns, or None.

    Raises:
        FileError: if a file that the options name does not exist.
        RecordingError: if the folder has several recordings.
    """
    named = {name: locate(text, folder) for name, text in run.files_of_views.items()}
    planner = _Planner(find_session(folder, named or None, is_of_board), run, options, detector is not None)
    return replace(planner.plan(), detector=detector, skeleton=skeleton)


class _Planner:
    """Makes the choices one after the other, and collects notes and problems."""

    def __init__(self, session: Session, run: RunOptions, options: Options, function_given: bool) -> None:
        self.session, self.run, self.options = session, run, options
        self.function_given = function_given
        self.notes: list[str] = []
        self.problems: list[str] = []
        self.views: tuple[ViewFacts, ...] = ()
        self.board_views: tuple[ViewImages, ...] = ()
        self.lens_views: tuple[ViewImages, ...] = ()

    def plan(self) -> RunPlan:
        """Return the plan."""
        stages = (self._detect(), self._calibrate(), self._synchronize())
        people = {"one": "one person", "many": "several people", "stills": "people in unrelated frames"}
        last = PlannedStage("reconstruct", people.get(self.options.people, "all people"), RESULT)
        report = [PlannedStage("report", "with the videos", REPORT)] if self.shows_videos else []
        return RunPlan(
            self.session,
            self.run,
            self.options,
            self.views,
            (*stages, last, *report),
            tuple(self.notes),
            tuple(self.problems),
            board_views=self.board_views,
            lens_views=self.lens_views,
        )

    @property
    def shows_videos(self) -> bool:
        """Whether the report can show videos beside the scene."""
        return bool(self.views) and all(view.is_video for view in self.views) and self.run.calibration != "none"

    @contextlib.contextmanager
    def _collected(self) -> Iterator[None]:
        """Collect an error as a problem, so that one message names all of them."""
        try:
            yield
        except PosefuseError as error:
            self.problems.append(str(error))

    def _locate(self, text: str) -> Path:
        return locate(text, self.session.folder)

    def _detect(self) -> PlannedStage:
        """Choose keypoints or a detector."""
        session, run = self.session, self.run
        asked = self.function_given or run.detect.detector is not None
        if run.keypoints is None and session.recording.keypoints and not (asked and session.views):
            with self._collected():
                found = relative(choose_keypoints(session.recording), session.folder)
                self.run = run = replace(run, keypoints=found)
                if session.views:
                    self.notes.append(
                        f"The videos are not examined, because there are 2D keypoints ({found}). `detector` detects "
                        "people nevertheless."
                    )
            if run.keypoints is None:
                return PlannedStage("detect", "several sets of 2D keypoints")
        if run.keypoints is not None:
            self._locate(run.keypoints)
            if session.views:
                # They state the sizes of images, and contain sound.
                self._examine(session.views, [])
            return PlannedStage("detect", f"nothing to do: 2D keypoints in {run.keypoints}")
        if not session.views:
            self.problems.append(_nothing_to_reconstruct(session))
            return PlannedStage("detect", "no videos")
        self._examine(session.views, self.problems)
        return PlannedStage("detect", self._detector(), KEYPOINTS)

    def _examine(self, views: tuple[ViewImages, ...], problems: list[str]) -> None:
        """Fix the videos, and look at each."""
        folder = self.session.folder
        files = [(view.name, view.files[0] if view.is_video else view.files[0].parent) for view in views]
        self.run = replace(self.run, videos=tuple(f"{name}={relative(file, folder)}" for name, file in files))
        try:
            import_pyav()
        except PosefuseError as error:
            problems.append(str(error))
            return
        self.views = examine_views(views, problems)

    def _detector(self) -> str:
        """Choose the detector, and return what the plan says of it."""
        if self.function_given:
            return "the given function"
        name = self.run.detect.detector
        with self._collected():
            if name is None:
                given = self.run.detect
                best = default_detector(
                    weights_given=bool(given.weights), python_given=given.detector_python is not None
                )
                name = best.name
                self.notes.append(f"Detector: {name}, {best.reason}.")
                self.run = replace(self.run, detect=replace(self.run.detect, detector=name))
            elif not name.endswith((".py", ".toml")) and self.run.detect.detector_python is None:
                installed_python(find_detector(name)[0])
        if name is None:
            return "no detector"
        return name

    def _calibrate(self) -> PlannedStage:
        """Choose what the cameras are calibrated by."""
        run = self.run
        wanted = run.calibration
        if run.intrinsics is not None:
            with self._collected():
                self._locate(run.intrinsics)
        if run.calibration_file is not None or (wanted == "auto" and self.session.recording.calibrations):
            return self._calibration_file(wanted)
        if wanted == "auto":
            with self._collected():
                _refuse_broken(self.session)
        flat = run.keypoints is None and len(self.views) == 1 and self.options.needs_no_poses
        if wanted == "none" or (wanted == "auto" and flat):
            self.run = replace(self.run, calibration="none")
            return PlannedStage("calibrate", "nothing to do: one camera")
        choice = self._board(wanted)
        if wanted == "board" or (wanted == "auto" and choice.views):
            return self._by_board(choice)
        self.run = replace(self.run, calibration="people", board=choice.board if self.lens_views else self.run.board)
        lenses = "" if self.run.intrinsics is None else f", with the lenses of {self.run.intrinsics}"
        return PlannedStage("calibrate", f"by the people{lenses or self._lenses()}", CALIBRATION)

    def _board(self, wanted: str) -> BoardChoice:
        """Choose the board and its images, or those of the lenses alone."""
        session, run = self.session, self.run
        if wanted == "people" and not session.lens_views and run.lens_images is None:
            return BoardChoice(None)
        choice = choose_board(session, run)
        # Who asks for a board cannot do without what is missing.
        (self.problems if wanted == "board" else self.notes).extend(choice.notes)
        self.problems += choice.problems
        if choice.board is None or choice.problems:
            return replace(choice, views=())
        if choice.lens_views:
            with self._collected():
                import_opencv()
            self.lens_views = choice.lens_views
            self.run = replace(run, lens_images=place_of(choice.lens_views, session.folder))
        return choice

    def _lenses(self) -> str:
        """Return what the plan says of lenses by a board."""
        return f", with the lenses by the board {self.run.board} in {self.run.lens_images}" if self.lens_views else ""

    def _calibration_file(self, wanted: str) -> PlannedStage:
        """Choose a calibration that exists."""
        session = self.session
        with self._collected():
            path = choose_calibration(session.recording) if wanted == "auto" else self._locate(wanted)
            self.run = replace(self.run, calibration=relative(path, session.folder))
            rig = read_cameras(path, length_unit=self.options.length_unit, up=self.options.up)
            check_sizes(self.views, rig, self.notes, self.problems)
            if self.run.keypoints is None:
                # Before people are detected, which takes minutes.
                with self._collected():
                    check_names(rig, [view.name for view in self.views], self.options)
            if self.run.board is not None:
                self.notes.append(
                    f"The board is not used, because there is a calibration ({self.run.calibration}). "
                    "`calibration='board'` calibrates by it."
                )
            if self.run.intrinsics is not None:
                self.notes.append(
                    f"The lenses of {self.run.intrinsics} are not used, because there is a calibration "
                    f"({self.run.calibration}). `calibration='people'` or `calibration='board'` calibrates with them."
                )
            if self.run.refine and len(rig) > 1:
                return PlannedStage("calibrate", f"{self.run.calibration}, refined by the people", CALIBRATION)
            return PlannedStage("calibrate", f"nothing to do: {_describe(rig)} in {self.run.calibration}")
        return PlannedStage("calibrate", "no calibration")

    def _by_board(self, choice: BoardChoice) -> PlannedStage:
        """Calibrate by a board."""
        self.run = replace(self.run, calibration="board", board=choice.board)
        with self._collected():
            import_opencv()
        if choice.board is None or not choice.views:
            if not (choice.problems or choice.notes):
                self.problems.append(_missing_board(self.session, choice))
            return PlannedStage("calibrate", "by a board", CALIBRATION)
        self.board_views = choice.views
        place = self.run.board_images or place_of(choice.views, self.session.folder)
        self.run = replace(self.run, board_images=place)
        text = f"by the board {choice.board} in {place}"
        return PlannedStage("calibrate", text + self._lenses().replace(f" {choice.board}", ""), CALIBRATION)

    def _synchronize(self) -> PlannedStage:
        """Choose the evidence on the clocks."""
        run, stamps = self.run, self.session.timestamps
        if run.timestamps is None and len(stamps) == 1 and self.views:
            with contextlib.suppress(PosefuseError):
                read_timestamps(stamps[0])
                self.run = run = replace(run, timestamps=relative(stamps[0], self.session.folder))
        if run.timestamps is not None:
            self._locate(run.timestamps)
        if run.sync_file is not None:
            self._locate(run.sync_file)
            return PlannedStage("synchronize", f"nothing to do: time offsets in {run.sync_file}")
        if len(self.views) == 1 or run.synchronize == "off" or self.options.people == "stills":
            self.run = replace(run, synchronize="off")
            return PlannedStage("synchronize", "nothing to do: the times of the views are used as they are")
        sources = [f"timestamps ({run.timestamps})"] if run.timestamps else []
        sources += ["sound", "start tags"] if self.views and self.views[0].is_video else []
        return PlannedStage("synchronize", f"by {choices([*sources, 'keypoints'])}", SYNC)


def _refuse_broken(session: Session) -> None:
    """Raise the error of a file that is named like a calibration but cannot be read."""
    try:
        choose_calibration(session.recording)
    except RecordingError as error:
        if "cannot be read" in str(error):
            raise


def _describe(rig: CameraRig) -> str:
    return "1 camera" if len(rig) == 1 else f"{len(rig)} cameras"


def _missing_board(session: Session, choice: BoardChoice) -> str:
    if choice.board is None and (session.board_views or session.views):
        return f"Nothing describes the board. Add `board='{EXAMPLE}'` with its kind and size."
    if choice.lens_views:
        return (
            f"{place_of(choice.lens_views, session.folder)} shows the board to one camera at a time, which gives "
            "lenses but no poses. Calibrate with `calibration='people'`, or film the board with all cameras."
        )
    return (
        f"{session.folder} has no images of a board. Put one video per camera into the folder "
        f"{session.folder / 'calibration'}, named like the videos of people."
    )


def _nothing_to_reconstruct(session: Session) -> str:
    if session.board_views:
        return (
            f"{session.folder} has images of a board ({place_of(session.board_views, session.folder)}), but neither "
            "videos of people nor 2D keypoints. To calibrate cameras alone, use posefuse calibrate."
        )
    return (
        f"{session.folder} has neither videos nor 2D keypoints; give a folder with one video, or one folder of "
        "pictures, per camera."
    )
