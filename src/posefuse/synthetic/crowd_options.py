"""What to simulate of several people: the record behind ``posefuse simulate-people`` and its flags."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from posefuse.errors import OptionsError, suggestion
from posefuse.synthetic.options import MOST_CAMERAS, DetectorOptions, LensKind

Scenario = Literal["crowd", "hug", "leave", "one_camera", "dark", "bumped", "ten"]
SCENARIOS: tuple[Scenario, ...] = get_args(Scenario)
MOST_PEOPLE = 30


@dataclass(frozen=True)
class CrowdFaults:
    """How the simulated detector errs where there are several people, beside each keypoint's own errors.

    Attributes:
        hidden_miss_share: Share of keypoints behind somebody or something that are missed, in spells of 0.2 s.
        hidden_confidence: What the confidence in the others is multiplied by; their errors grow by as much.
        hidden_error: What their errors are multiplied by on top of that.
        visible_share: A person with less than this share of keypoints in sight is not detected.
        smallest_px: A person whose keypoints span less than this, in px, is not detected.
        miss_share: Share of people not detected though they are in sight, in spells of 0.3 s.
        merge_share: Share of the time that two people overlap in a view in which one detection comes of both, in spells
            of 0.4 s.
        merge_distance: Two people overlap if their middles are nearer than this share of their height in the image.
        duplicate_share: Share of people detected twice, in spells of 0.2 s.
        false_share: Share of frames in which a view shows a person that is not there, in spells of 2 s.
        track_ids: Whether each view's detector gives identities of its own.
        id_change_hz: How often a view's identity of a person changes for no reason, times a second.
        id_swap_share: Share of overlaps after which two identities are exchanged in that view.
        shuffled: Whether people come in any order in a view and frame; else by person.
    """

    hidden_miss_share: float = 0.5
    hidden_confidence: float = 0.5
    hidden_error: float = 1.5
    visible_share: float = 0.3
    smallest_px: float = 40.0
    miss_share: float = 0.01
    merge_share: float = 0.3
    merge_distance: float = 0.22
    duplicate_share: float = 0.02
    false_share: float = 0.03
    track_ids: bool = False
    id_change_hz: float = 0.02
    id_swap_share: float = 0.1
    shuffled: bool = True

    def __post_init__(self) -> None:
        for name in ("miss_share", "merge_share", "duplicate_share", "false_share", "id_swap_share"):
            _check_share(name, getattr(self, name))
        for name in ("hidden_miss_share", "hidden_confidence", "visible_share"):
            _check_share(name, getattr(self, name))
        if not self.hidden_confidence > 0:
            raise OptionsError("hidden_confidence must be more than 0: errors are divided by the confidence.")
        for name in ("hidden_error", "smallest_px", "merge_distance", "id_change_hz"):
            if not getattr(self, name) >= 0:
                raise OptionsError(f"{name} must be 0 or more, got {getattr(self, name)}.")


@dataclass(frozen=True)
class CrowdOptions:
    """What to simulate of several people.

    What is left out is the scenario's own: 5 cameras, 25 frames a second, and

    ============  ======  =======  ===================================================================
    scenario      people  seconds  what happens
    ============  ======  =======  ===================================================================
    crowd         4       60       people walk and cross each other's paths; half come later and go
    hug           2       20       two meet, hug for 1 to 2 s, separate and swap places
    leave         2       30       one leaves for 5 s and returns, the other stays
    one_camera    2       20       boards hide one person from all views but one for 2 s
    dark          3       30       a camera shows nothing for 10 s
    bumped        3       30       a camera shows nothing for 2 s and comes back turned by 20 degrees
    ten           10      30       ten people, 8 cameras, a wider room
    ============  ======  =======  ===================================================================

    Attributes:
        scenario: What happens.
        people: How many.
        cameras: How many, 2 to 32.
        duration_s: How long.
        rate_hz: Frames per second.
        statures_m: One for each person; by default drawn from 1.55 to 1.9 m, in a hug 8 % apart.
        equal_statures: Everybody is of one stature: bones tell nobody apart.
        skeleton: Which keypoints of a human, a shipped name or a TOML file.
        lens: What the cameras see through.
        seed: Of everything random; the same seed gives the same bytes.
        detector: How keypoints err.
        faults: How the detector errs where there are several people.
    """

    scenario: Scenario = "crowd"
    people: int | None = None
    cameras: int | None = None
    duration_s: float | None = None
    rate_hz: float = 25.0
    statures_m: tuple[float, ...] = ()
    equal_statures: bool = False
    skeleton: str = "body_20"
    lens: LensKind = "pinhole"
    seed: int = 0
    detector: DetectorOptions = field(default_factory=DetectorOptions)
    faults: CrowdFaults = field(default_factory=CrowdFaults)

    def __post_init__(self) -> None:
        object.__setattr__(self, "statures_m", tuple(self.statures_m))
        if self.scenario not in SCENARIOS:
            raise OptionsError(f"No scenario {self.scenario!r}. {suggestion(self.scenario, SCENARIOS)}")
        least = {"crowd": 1, "ten": 1, "dark": 1, "bumped": 1}.get(self.scenario, 2)
        if self.people is not None and not least <= self.people <= MOST_PEOPLE:
            raise OptionsError(f"Scenario {self.scenario} has {least} to {MOST_PEOPLE} people, got {self.people}.")
        if self.scenario == "hug" and self.people not in (None, 2):
            raise OptionsError(f"Scenario hug has 2 people, got {self.people}.")
        if self.cameras is not None and not 2 <= self.cameras <= MOST_CAMERAS:
            raise OptionsError(f"People are seen by 2 to {MOST_CAMERAS} cameras, got {self.cameras}.")
        if not self.rate_hz > 0:
            raise OptionsError(f"rate_hz must be positive, got {self.rate_hz}.")
        shortest = SHORTEST_S[self.scenario]
        if self.duration_s is not None and not self.duration_s >= shortest:
            raise OptionsError(f"Scenario {self.scenario} lasts at least {shortest:g} s, got {self.duration_s}.")
        if self.statures_m and len(self.statures_m) != self.n_people:
            raise OptionsError(f"statures_m needs one for each of {self.n_people} people, got {len(self.statures_m)}.")
        if not all(0.5 <= stature <= 2.5 for stature in self.statures_m):
            raise OptionsError(f"statures_m must lie between 0.5 and 2.5 m, got {self.statures_m}.")
        if self.detector.max_offset_s:
            raise OptionsError("Scenes of several people have one clock: leave detector.max_offset_s at 0.")

    @property
    def n_people(self) -> int:
        """How many people."""
        return _PEOPLE[self.scenario] if self.people is None else self.people

    @property
    def n_cameras(self) -> int:
        """How many cameras."""
        return (8 if self.scenario == "ten" else 5) if self.cameras is None else self.cameras

    @property
    def length_s(self) -> float:
        """How long, s."""
        return DURATIONS_S[self.scenario] if self.duration_s is None else self.duration_s

    @property
    def n_frames(self) -> int:
        """How many frames."""
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
"""How long each scenario lasts when nobody says."""
SHORTEST_S: dict[Scenario, float] = {
    "crowd": 1e-9,
    "hug": 16.0,
    "leave": 22.0,
    "one_camera": 10.0,
    "dark": 20.0,
    "bumped": 12.0,
    "ten": 1e-9,
}
"""What a scenario needs for what happens in it."""


def _check_share(name: str, value: float) -> None:
    if not 0.0 <= value <= 1.0:
        raise OptionsError(f"{name} must lie between 0 and 1, got {value}.")


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
"""Everybody in the image is detected once, in order, as if nothing were between."""
