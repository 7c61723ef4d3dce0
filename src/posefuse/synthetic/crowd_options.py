"""Options of ``posefuse simulate-people``: the scene and the errors of its detector."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, option
from posefuse.synthetic.options import MOST_CAMERAS, DetectorOptions, LensKind

Scenario = Literal["crowd", "hug", "leave", "one_camera", "dark", "bumped", "ten"]
SCENARIOS: tuple[Scenario, ...] = get_args(Scenario)
MOST_PEOPLE = 30


@dataclass(frozen=True)
class CrowdFaults:
    """Detector errors that occur with several people, in addition to each keypoint's own errors.

    Attributes:
        hidden_miss_share: Fraction of occluded keypoints that are missed, in intervals of 0.2 s.
        hidden_confidence: Factor for the confidence of occluded keypoints; their errors grow by its inverse.
        hidden_error: Further factor on the errors of occluded keypoints.
        visible_share: Minimum fraction of visible keypoints at which a person is detected.
        smallest_px: Minimum extent in the image at which a person is detected.
        miss_share: Fraction of visible people that are not detected, in intervals of 0.3 s.
        merge_share: Fraction of the time in which two people overlap in a view and give one merged detection, in
            intervals of 0.4 s.
        merge_distance: Distance of two people's centers at which they overlap, relative to their height in the image.
        taken_share: Fraction of the time in which a detection shows a limb of an overlapping person instead of the own
            occluded one, in intervals of 0.4 s.
        duplicate_share: Fraction of people that are detected twice, in intervals of 0.2 s.
        false_share: Fraction of frames in which a view has a false person, in intervals of 2 s.
        track_ids: Give each view's detections track IDs.
        id_change_hz: Rate at which a view's track ID of a person changes at random.
        id_swap_share: Fraction of overlaps after which two track IDs are swapped in the view.
        shuffled: Shuffle the detections of every view and frame instead of ordering them by person.
    """

    hidden_miss_share: float = option(0.5, at_least=0.0, at_most=1.0)
    hidden_confidence: float = option(0.5, above=0.0, at_most=1.0)
    hidden_error: float = option(1.5, at_least=0.0)
    visible_share: float = option(0.3, at_least=0.0, at_most=1.0)
    smallest_px: float = option(40.0, at_least=0.0)
    miss_share: float = option(0.01, at_least=0.0, at_most=1.0)
    merge_share: float = option(0.3, at_least=0.0, at_most=1.0)
    merge_distance: float = option(0.22, at_least=0.0)
    taken_share: float = option(0.0, at_least=0.0, at_most=1.0)
    duplicate_share: float = option(0.02, at_least=0.0, at_most=1.0)
    false_share: float = option(0.03, at_least=0.0, at_most=1.0)
    track_ids: bool = False
    id_change_hz: float = option(0.02, at_least=0.0)
    id_swap_share: float = option(0.1, at_least=0.0, at_most=1.0)
    shuffled: bool = True

    def __post_init__(self) -> None:
        check_fields(self, "faults")


@dataclass(frozen=True)
class CrowdOptions:
    """Options of a simulated scene with several people.

    Options that are not set take the values of the scenario, with 5 cameras and 25 frames per second:

    ============  ======  =======  ===================================================================
    scenario      people  seconds  what happens
    ============  ======  =======  ===================================================================
    crowd         4       60       people walk and cross each other's paths; half enter late and leave
    hug           2       20       two meet, hug for 1 to 2 s, separate and swap places
    leave         2       30       one leaves for 5 s and returns, the other stays
    one_camera    2       20       boards hide one person from all views but one for 2 s
    dark          3       30       a camera shows nothing for 10 s
    bumped        3       30       a camera shows nothing for 2 s and comes back turned by 20 degrees
    ten           10      30       ten people, 8 cameras, a wider room
    ============  ======  =======  ===================================================================

    Attributes:
        scenario: Scenario of the scene.
        people: Number of people; by default the scenario's.
        cameras: Number of cameras; by default 5, and 8 in the scenario ten.
        duration_s: Duration of the recording; by default the scenario's.
        rate_hz: Frame rate.
        statures_m: Standing height of each person; by default random between 1.55 and 1.9 m, in a hug 8 % apart.
        equal_statures: Give all people the same bone lengths, so that these do not identify anyone.
        skeleton: Human keypoint set, as a built-in name or a TOML file.
        lens: Lens model of the cameras.
        seed: Random seed; the same seed gives the same bytes.
        detector: Errors of keypoints.
        faults: Detector errors that occur with several people.
    """

    scenario: Scenario = "crowd"
    people: int | None = option(None, at_least=1, at_most=MOST_PEOPLE)
    cameras: int | None = option(None, at_least=2, at_most=MOST_CAMERAS)
    duration_s: float | None = option(None, above=0.0)
    rate_hz: float = option(25.0, above=0.0)
    statures_m: tuple[float, ...] = option((), at_least=0.5, at_most=2.5)
    equal_statures: bool = False
    skeleton: str = "body_20"
    lens: LensKind = "pinhole"
    seed: int = option(0, at_least=0)
    detector: DetectorOptions = field(default_factory=DetectorOptions)
    faults: CrowdFaults = field(default_factory=CrowdFaults)

    def __post_init__(self) -> None:
        check_fields(self, "")
        least = {"crowd": 1, "ten": 1, "dark": 1, "bumped": 1}.get(self.scenario, 2)
        if self.people is not None and not least <= self.people <= MOST_PEOPLE:
            raise OptionsError(f"Scenario {self.scenario} needs {least} to {MOST_PEOPLE} people, got {self.people}.")
        if self.scenario == "hug" and self.people not in (None, 2):
            raise OptionsError(f"Scenario hug needs 2 people, got {self.people}.")
        shortest = SHORTEST_S[self.scenario]
        if self.duration_s is not None and not self.duration_s >= shortest:
            raise OptionsError(f"Scenario {self.scenario} must last at least {shortest:g} s, got {self.duration_s}.")
        if self.statures_m and len(self.statures_m) != self.n_people:
            raise OptionsError(
                f"statures_m needs one value for each of {self.n_people} people, got {len(self.statures_m)}."
            )
        if self.detector.max_offset_s:
            raise OptionsError("Scenes of several people have one clock: leave detector.max_offset_s at 0.")

    @property
    def n_people(self) -> int:
        """Number of people."""
        return _PEOPLE[self.scenario] if self.people is None else self.people

    @property
    def n_cameras(self) -> int:
        """Number of cameras."""
        return (8 if self.scenario == "ten" else 5) if self.cameras is None else self.cameras

    @property
    def length_s(self) -> float:
        """Duration in s."""
        return DURATIONS_S[self.scenario] if self.duration_s is None else self.duration_s

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return max(1, round(self.length_s * self.rate_hz))


_PEOPLE: dict[Scenario, int] = {
    "crowd": 4,
    "hug": 2,
    "leave": 2,
    "one_camera": 2,
    "dark": 3,
    "bumped": 3,
    "ten": 10,
}
DURATIONS_S: dict[Scenario, float] = {
    "crowd": 60.0,
    "hug": 20.0,
    "leave": 30.0,
    "one_camera": 20.0,
    "dark": 30.0,
    "bumped": 30.0,
    "ten": 30.0,
}
"""Default duration of each scenario."""
SHORTEST_S: dict[Scenario, float] = {
    "crowd": 1e-9,
    "hug": 16.0,
    "leave": 22.0,
    "one_camera": 10.0,
    "dark": 20.0,
    "bumped": 12.0,
    "ten": 1e-9,
}
"""Minimum duration of each scenario."""


NO_FAULTS = CrowdFaults(
    hidden_miss_share=0.0,
    hidden_confidence=1.0,
    hidden_error=1.0,
    visible_share=0.0,
    smallest_px=0.0,
    miss_share=0.0,
    merge_share=0.0,
    duplicate_share=0.0,
    false_share=0.0,
    shuffled=False,
)
"""Every person in the image is detected once, in order, without occlusion."""
