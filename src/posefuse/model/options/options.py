"""All options of a reconstruction in one record.

The Python API, the flags of the command line and the TOML file all use this record. The text of each attribute is the
help that ``--help``, the file of ``posefuse init`` and ``docs/options.md`` show.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Literal

from posefuse.described import Described, Description
from posefuse.errors import OptionsError, choices
from posefuse.model.cameras import UpAxis
from posefuse.model.options.alignment import AlignOptions
from posefuse.model.options.association import AssociationOptions
from posefuse.model.options.bounds import check_fields, check_no_repetition, option
from posefuse.model.options.left_right import SideMethod, SideOptions
from posefuse.model.options.named_numbers import named_numbers
from posefuse.model.options.noise import NoiseOptions
from posefuse.model.options.pairs import PairMethod, PairOptions
from posefuse.model.options.postprocess import PostprocessOptions
from posefuse.model.options.subject import SubjectOptions, as_time
from posefuse.model.options.sync import SyncOptions
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.options.trajectory import TrajectoryOptions
from posefuse.model.options.triangulation import TriangulationOptions

People = Literal["auto", "one", "many", "stills"]
Bodies = Literal["auto", "fit", "none"]
Switch = Literal["on", "off"]
Pick = Literal["largest", "track-id"]
ThirdChannel = Literal["confidence", "depth"]
LengthUnit = Literal["m", "cm", "mm"]
LayerName = Literal["measured", "solved", "model"]
Solve = Literal["auto", "frame", "trajectory"]


@dataclass(frozen=True, repr=False)
class Options(Described):
    """All options of a reconstruction.

    Attributes:
        people: People to find: one, many, stills or auto. "stills" associates unrelated frames one by one; "auto"
            counts people, and selects "stills" if frames are far apart.
        person: Names of the people to keep, such as person_1; all by default.
        bodies: Fit articulated models: auto, fit or none. "auto" fits them to several people, "fit" also to one.
        pick: Person to use of several: largest or track-id. Without it, all people are kept, or with
            people = "one" the person who stays longest in the common volume of the cameras.
        skeleton: Keypoint set: a built-in name or a TOML file. By default it is inferred from the files.
        rate_hz: Frame rate, if the files do not state it.
        view_rates_hz: Frame rates of views that started together, each as view=rate, such as cam_2=60; other views use
            rate_hz.
        reference_view: View whose frames define the common timeline; by default the slowest, or the
            longest of several equally slow ones.
        third_channel: Meaning of the third number of a keypoint array.
        image_size: Width and height of the images, for keypoints given as fractions of the image.
        length_unit: Length unit of the calibration: m, cm or mm. It is needed if the format does not define it.
        up: Up axis of the calibration, such as z or -y. It is needed if the format does not define it.
        cameras: Names of the cameras to use; all by default.
        exclude_camera: Names of the cameras to leave out.
        camera_order: Name of each view's camera, in the order of the views, for when view and camera names differ.
        start_s: Start of the part to reconstruct.
        end_s: End of the part to reconstruct, exclusive.
        noise_scale_px: Standard deviation of every detection per axis; by default estimated from the recording.
        health: Check of the recording for wrong calibrations, swapped cameras, time offsets and similar faults: on or
            off.
        layer: Layer to export and evaluate: measured, solved or model. By default it is the one that predicts left-out
            views best.
        triangulation: Options of triangulation.
        noise: Options of the detection noise.
        sync: Time offsets of the views.
        pairs: Solution of left/right keypoint pairs: "enumerate" and "sds" solve both points together, "labels" each by
            its label. The default is "enumerate" with the method "consensus", otherwise "labels".
        sides: Left/right assignment of solved pairs: "chains" (per limb, over time), "votes" (per frame) or "plane"
            (from the facing direction).
        pair_search: Options of the search for pairs.
        side_search: Options of the left/right assignment.
        association: Options of cross-view association.
        tracker: Options of the multi-person tracker.
        solve: Solve per frame or over time: frame, trajectory or auto. "auto" solves all frames together for one
            subject or tracked people, two or more cameras, half a second or more, and the method "consensus".
        trajectory: Options of the trajectory solve.
        contact: Keep feet from sliding and sinking in the trajectory solve and in fitted bodies: on or off.
        postprocess: Options of postprocessing.
        session_start: Date and time of the recording's time 0 with time zone, such as 2024-05-03T14:30:00+02:00, in
            NWB files.
        subject: Properties of the subject.
        align: Coordinate system and scale of the result.
        chunk_frames: Number of frames that are processed at once; longer recordings store every finished chunk, so that
            the same command resumes after an interruption.
    """

    people: People = option("auto", common=True)
    person: tuple[str, ...] = option((), example='["person_1"]')
    bodies: Bodies = option("auto", common=True)
    pick: Pick | None = option(None, common=True)
    skeleton: str | None = option(None, common=True, example='"coco_17"')
    rate_hz: float | None = option(None, above=0.0, common=True, example="60.0")
    view_rates_hz: tuple[str, ...] = option((), example='["cam_2=60"]')
    reference_view: str | None = option(None, example='"cam_1"')
    third_channel: ThirdChannel | None = None
    image_size: tuple[int, ...] = option((), at_least=1, unit="px", lengths=(0, 2), example="[1920, 1080]")
    length_unit: LengthUnit | None = option(None, common=True)
    up: UpAxis | None = option(None, common=True, example='"z"')
    cameras: tuple[str, ...] = option((), common=True, example='["cam_1", "cam_2", "cam_3"]')
    exclude_camera: tuple[str, ...] = option((), common=True, example='["cam_4"]')
    camera_order: tuple[str, ...] = option((), example='["cam_2", "cam_1"]')
    start_s: float | None = option(None, common=True, example="2.0")
    end_s: float | None = option(None, common=True, example="12.0")
    noise_scale_px: float | None = option(None, above=0.0, example="4.5")
    health: Switch = "on"
    layer: LayerName | None = option(None, common=True)
    triangulation: TriangulationOptions = field(default_factory=TriangulationOptions)
    noise: NoiseOptions = field(default_factory=NoiseOptions)
    sync: SyncOptions = field(default_factory=SyncOptions)
    pairs: PairMethod | None = None
    sides: SideMethod = "chains"
    pair_search: PairOptions = field(default_factory=PairOptions)
    side_search: SideOptions = field(default_factory=SideOptions)
    association: AssociationOptions = field(default_factory=AssociationOptions)
    tracker: TrackerOptions = field(default_factory=TrackerOptions)
    solve: Solve = option("auto", common=True)
    trajectory: TrajectoryOptions = field(default_factory=TrajectoryOptions)
    contact: Switch = "on"
    postprocess: PostprocessOptions = field(default_factory=PostprocessOptions)
    session_start: str | None = option(None, example='"2024-05-03T14:30:00+02:00"')
    subject: SubjectOptions = field(default_factory=SubjectOptions)
    align: AlignOptions = field(default_factory=AlignOptions)
    chunk_frames: int = option(2048, at_least=1)

    def _description(self) -> Description:
        changed = tuple((name, str(value)) for name, value in _changes(self, Options()))
        return Description("Options: all defaults" if not changed else "Options: defaults, but", changed)

    def __post_init__(self) -> None:
        check_fields(self, "")
        if self.start_s is not None and self.end_s is not None and self.end_s <= self.start_s:
            raise OptionsError(f"end_s ({self.end_s}) must be above start_s ({self.start_s}).")
        for name, rate_hz in self.rates_hz.items():
            if not (name and 0.0 < rate_hz < math.inf):
                raise OptionsError(
                    f"view_rates_hz must contain view=rate entries with rates above 0 Hz, got {name}={rate_hz}."
                )
        if self.session_start is not None:
            start = as_time(self.session_start, "session_start", "2024-05-03T14:30:00+02:00")
            born = self.subject.date_of_birth
            if born is not None and as_time(born, "subject.date_of_birth", "1998-04-12") > start:
                raise OptionsError(
                    f"subject.date_of_birth ({born}) must be before session_start ({start.isoformat()})."
                )
        for name in ("person", "cameras", "exclude_camera", "camera_order"):
            check_no_repetition(getattr(self, name), name)
        both = sorted(set(self.cameras) & set(self.exclude_camera))
        if both:
            raise OptionsError(
                f"cameras and exclude_camera must not name the same camera, got {choices(both)} in both."
            )

    @property
    def needs_no_poses(self) -> bool:
        """Whether the keypoints of a single camera can be placed in its image plane without its calibration."""
        return self.triangulation.flatten_single_view and self.people != "many" and self.bodies != "fit"

    @property
    def rates_hz(self) -> dict[str, float]:
        """Frame rates in ``view_rates_hz``, by view.

        Raises:
            OptionsError: if an entry is not view=rate.
        """
        return named_numbers(self.view_rates_hz, "view_rates_hz", "view=rate", "cam_2=60")


def _changes(value: Any, default: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the names of options that differ from their defaults, and their values."""
    for each in fields(value):
        own, usual = getattr(value, each.name), getattr(default, each.name)
        path = f"{name}.{each.name}" if name else each.name
        if is_dataclass(own) and type(own) is type(usual):
            yield from _changes(own, usual, path)
        elif own != usual:
            yield path, own
