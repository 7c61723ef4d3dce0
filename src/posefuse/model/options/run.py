"""Options of a run from videos to a report."""

from dataclasses import dataclass, field

from posefuse.model.options.bounds import check_fields, option
from posefuse.model.options.calibration import CalibrateOptions, PeopleOptions
from posefuse.model.options.detection import DetectOptions
from posefuse.model.options.named_numbers import named_texts

WAYS_TO_CALIBRATE = ("auto", "board", "people", "none")
"""Values of ``calibration`` that are not the name of a file."""
WAYS_TO_SYNCHRONIZE = ("auto", "off")
"""Values of ``synchronize`` that are not the name of a file."""


@dataclass(frozen=True)
class RunInputs:
    """The files from which a run was made.

    Attributes:
        sha256: Digest of each input as file=digest, as posefuse.toml lists them; other content gives a warning.
    """

    sha256: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self, "inputs")

    @property
    def digests(self) -> dict[str, str]:
        """Digests by file."""
        return named_texts(self.sha256, "inputs.sha256", "file=digest", "videos/cam1.mp4=2c26b46b...")


@dataclass(frozen=True)
class RunOptions:
    """Options of a run from videos to a report. Paths are relative to the recording's folder, or to the current one.

    Attributes:
        calibration: Calibration file, or what to calibrate by: board, people or auto. "auto" takes the calibration in
            the folder, else a board, else the people.
        board: Board to calibrate by, such as charuco:7x5,square=30mm, or its file; by default the one described beside
            its images.
        refine: Adjust the poses of a given calibration to the people, if that predicts held-out frames better.
        intrinsics: Calibration file with known lenses, for a calibration by a board or by people.
        keypoints: File or folder of 2D keypoints to use instead of a detection.
        timestamps: File or folder of frame times; by default those in the folder.
        synchronize: Measure the time offsets of the views (auto), trust their times (off), or a file of posefuse sync.
        max_offset_s: Largest difference between the start times of two videos.
        videos: Videos of people as view=file; by default those in the folder.
        board_images: Folder with the images of the board; by default searched for.
        lens_images: Folder with images of the board by single cameras, for their lenses; by default searched for.
        detect: Options of the detection.
        by_board: Options of a calibration by a board.
        by_people: Options of a calibration by people.
        inputs: Files from which the run was made.
    """

    calibration: str = "auto"
    board: str | None = None
    refine: bool = False
    intrinsics: str | None = None
    keypoints: str | None = None
    timestamps: str | None = None
    synchronize: str = "auto"
    max_offset_s: float = option(10.0, at_least=0.0, at_most=60.0)
    videos: tuple[str, ...] = option((), example='["cam1=videos/cam1.mp4"]')
    board_images: str | None = None
    lens_images: str | None = None
    detect: DetectOptions = field(default_factory=DetectOptions)
    by_board: CalibrateOptions = field(default_factory=CalibrateOptions)
    by_people: PeopleOptions = field(default_factory=PeopleOptions)
    inputs: RunInputs = field(default_factory=RunInputs)

    def __post_init__(self) -> None:
        check_fields(self, "")
        named_texts(self.videos, "videos", "view=file", "cam1=videos/cam1.mp4")

    @property
    def calibration_file(self) -> str | None:
        """The calibration file, or None if the cameras are to be calibrated."""
        return None if self.calibration in WAYS_TO_CALIBRATE else self.calibration

    @property
    def sync_file(self) -> str | None:
        """The file of time offsets, or None if they are to be measured."""
        return None if self.synchronize in WAYS_TO_SYNCHRONIZE else self.synchronize

    @property
    def files_of_views(self) -> dict[str, str]:
        """Files in ``videos``, by view."""
        return named_texts(self.videos, "videos", "view=file", "cam1=videos/cam1.mp4")
