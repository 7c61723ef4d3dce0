"""Benchmark of tracking people in simulated scenes, compared with a baseline: identities, errors and coverage.

``python -m benchmarks.people [--only crowd,hug,...,equal,ablations] [--seeds 20] [--baseline-seeds 3]
[--ablation-seeds 3]``. Prints the tables of docs/benchmarks.md. All results except the smoother of the ablations are
causal: each frame is scored as reported when it was the latest.
Times are CPU times of all threads; ``benchmarks.tracking_speed`` measures them in more detail.
Scenes are cached in the system's temporary folder; a new version of the simulation creates new ones.
"""

import argparse
import hashlib
import pickle
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.stats import chi2

import posefuse
from benchmarks import rpt_kalman
from posefuse.evaluation.matching import is_here, matches_of, mean_distances_m
from posefuse.evaluation.paired_results import PeoplePoints
from posefuse.evaluation.people import PeopleScores, ScoringOptions, score_people
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.reconstruction import unpack_covariance
from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.synthetic.crowd_options import SCENARIOS, CrowdOptions, Scenario
from posefuse.synthetic.crowds import CrowdScene, Kind, simulate_crowd
from posefuse.tracking.history import History
from posefuse.tracking.records import People, Person
from posefuse.tracking.smoothing import PeopleSmoother
from posefuse.tracking.strategies import find_strategy
from posefuse.tracking.tracker import ArticulatedTracker

_GATE_M = 0.5
_END_S = 1.0
_WIDE = 25.0
"""Factor for the prior variance of bone lengths, for the ablation with weakly constrained bones."""
_ABLATED_CROWD_S = 20.0
_NAMES = (*SCENARIOS, "equal")


@dataclass(frozen=True)
class Alone:
    """People observed by a single view: errors along the ray and their standard deviations.

    Attributes:
        off_m: shape (case,): mean error over the body, positive away from the camera.
        sd_m: shape (case,): standard deviation along the ray, mean over the body.
        squared: shape (case, keypoint): squared Mahalanobis distance from the truth.
    """

    off_m: np.ndarray
    sd_m: np.ndarray
    squared: np.ndarray


@dataclass(frozen=True)
class Run:
    """Result of tracking one scene.

    Attributes:
        scores: scores of active people.
        right: whether each true person has the same name at the start and at the end.
        events: all events.
        refused: names of rejected cameras.
        moved: name of the camera that moved, or None.
        frame_s: shape (frame,): time per frame.
        alone: people in frames in which a single view observes them.
    """

    scores: PeopleScores
    right: bool
    events: tuple[Event, ...]
    refused: tuple[str, ...]
    moved: str | None
    frame_s: np.ndarray
    alone: "Alone"

    @property
    def is_fine(self) -> bool:
        """Whether identities are correct and the camera that moved is the only rejected one."""
        return self.right and set(self.refused) == ({self.moved} if self.moved else set())


def scene_of(options: CrowdOptions) -> CrowdScene:
    """Return a simulated scene from the cache."""
    # Scenes are pickled, so the cache key includes the code of the records as well as that of the simulation.
    sources = sorted(
        file for folder in ("synthetic", "model") for file in (Path(posefuse.__file__).parent / folder).glob("*.py")
    )
    version = hashlib.sha256(b"".join(path.read_bytes() for path in sources) + repr(options).encode()).hexdigest()[:16]
    file = Path(tempfile.gettempdir()) / "posefuse-benchmarks" / f"{options.scenario}-{options.seed}-{version}.pkl"
    if file.exists():
        return pickle.loads(file.read_bytes())
    scene = simulate_crowd(options)
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(pickle.dumps(scene))
    return scene


def scenario_of(name: str, seed: int) -> CrowdOptions:
    """Return the options of a scene; ``equal`` is a hug of two people with equal bone lengths."""
    if name == "equal":
        return CrowdOptions("hug", seed=seed, equal_statures=True)
    return CrowdOptions(next(each for each in SCENARIOS if each == name), seed=seed)


def tracker_for(scene: CrowdScene, options: TrackerOptions) -> ArticulatedTracker:
    """Return a live tracker, configured like the public one."""
    chosen = Options(tracker=options)
    return tracker_of(scene.rig, scene.detections.skeleton, default_noise(scene.rig, chosen), chosen)


def follow(
    scene: CrowdScene, tracker: ArticulatedTracker, *, smoothed: bool = False, scoring: ScoringOptions | None = None
) -> Run:
    """Track all people, frame by frame.

    Args:
        scene: scene to track.
        tracker: new tracker.
        smoothed: whether the smoothed people are scored, in frames in which they were active.
        scoring: options of the scores.
    """
    told: list[People] = []
    history = History(tracker.settings)
    numbers: list[dict[str, int]] = []
    spent = np.empty(scene.detections.n_frames)
    for i in range(len(spent)):
        frame = Frame.of(scene.detections, i)
        start = time.process_time()
        tracked = tracker.process(frame)
        told.append(tracked.people)
        spent[i] = time.process_time() - start
        if smoothed:
            history.add(tracker, tracked)
            numbers.append({track.name: track.number for track in tracker.tracks})
    events = tuple(event for people in told for event in people.events)
    data = _points(scene, _smoothed(history, told, numbers) if smoothed else told)
    bumped = [span.view for span in scene.spans if span.what == "bumped" and span.view is not None]
    return Run(
        score_people(data, scoring or ScoringOptions()),
        is_right(data),
        events,
        tuple(dict.fromkeys(event.person for event in events if event.what == "camera_rejected")),
        scene.rig.names[bumped[0]] if bumped else None,
        spent,
        single_view_errors(scene, told),
    )


def single_view_errors(scene: CrowdScene, told: Sequence[People]) -> Alone:
    """Return active people observed by a single view, in a detection of one person, with that person's truth."""
    truth, views = np.asarray(scene.truth.layers["measured"].points_m), len(scene.rig)
    off, sd, squared = [], [], []
    for f, people in enumerate(told):
        for person in people.people:
            view = np.flatnonzero(person.rows >= 0)
            if person.state != TrackState.ACTIVE or len(view) != 1:
                continue
            row = int(scene.detections.offsets[f * views] + person.rows[view[0]])
            if scene.kind[row] not in (Kind.PERSON, Kind.DUPLICATE):
                continue
            there = truth[f, scene.owner[row]]
            ray = there.mean(axis=0) - scene.rig.cameras[view[0]].center_m
            ray /= np.linalg.norm(ray)
            error, covariance = person.points_m - there, unpack_covariance(person.covariance_m2)
            off.append((error @ ray).mean())
            sd.append(np.sqrt(ray @ covariance @ ray).mean())
            squared.append((error * np.linalg.solve(covariance, error[..., None])[..., 0]).sum(axis=-1))
    keypoints = truth.shape[2]
    return Alone(np.array(off), np.array(sd), np.array(squared).reshape(-1, keypoints))


def _smoothed(history: History, told: Sequence[People], numbers: Sequence[dict[str, int]]) -> list[People]:
    """Return the same people as smoothed; ``numbers`` are the numbers of their bodies by frame and name."""
    places: dict[tuple[int, int | None], tuple[np.ndarray, np.ndarray]] = {}
    for each in PeopleSmoother(history).take(len(told)):
        for i, place in enumerate(each.places):
            places[int(place), each.number] = each.body.points_m[i], each.body.covariance_m2[i]
    return [
        replace(people, people=tuple(_moved(p, places.get((f, numbers[f].get(p.name)))) for p in people.people))
        for f, people in enumerate(told)
    ]


def _moved(person: Person, to: tuple[np.ndarray, np.ndarray] | None) -> Person:
    return person if to is None else replace(person, points_m=to[0], covariance_m2=to[1])


def _points(scene: CrowdScene, told: Sequence[People]) -> PeoplePoints:
    active = [{p.name: p for p in people.people if p.state == TrackState.ACTIVE} for people in told]
    names = tuple(dict.fromkeys(name for people in active for name in people))
    shape = (len(told), len(names), len(scene.detections.skeleton))
    points, covariance = np.full((*shape, 3), np.nan), np.full((*shape, 6), np.nan)
    for f, people in enumerate(active):
        for name, person in people.items():
            points[f, names.index(name)], covariance[f, names.index(name)] = person.points_m, person.covariance_m2
    truth = scene.truth
    return PeoplePoints(
        truth.skeleton, points, np.asarray(truth.layers["measured"].points_m), np.asarray(truth.time_s),
        unpack_covariance(covariance), names, truth.person_ids,
    )  # fmt: skip


def is_right(data: PeoplePoints) -> bool:
    """Return whether each true person has the same name in the last second as at first.

    Raises:
        ValueError: if the data have no times.
    """
    if data.time_s is None:
        raise ValueError("Comparing identities at the end needs the times of frames, which these points lack.")
    here, found = is_here(data.truth_m), is_here(data.points_m)
    person = matches_of(mean_distances_m(data.points_m, data.truth_m), found, here, _GATE_M).person
    for t in range(person.shape[1]):
        last_s = data.time_s[here[:, t]][-1]
        at_end = person[here[:, t] & (data.time_s > last_s - _END_S), t]
        named = person[person[:, t] >= 0, t]
        if not len(named) or np.bincount(at_end + 1).argmax() != named[0] + 1:
            return False
    return True


def baseline(scene: CrowdScene) -> PeopleScores:
    """Track the scene with the baseline: pairwise proposals, nearest poses and a Kalman filter per keypoint."""
    noise = default_noise(scene.rig, Options())
    names, points = rpt_kalman.follow(scene.rig, scene.detections, noise)
    truth = scene.truth
    known = np.asarray(truth.layers["measured"].points_m)
    return score_people(
        PeoplePoints(
            truth.skeleton, points, known, np.asarray(truth.time_s), person_ids=names, truth_ids=truth.person_ids
        )
    )


def _ghost(scores: PeopleScores) -> int:
    return max((ghost.longest for ghost in scores.ghosts), default=0)


HEAD = (
    "| scene | seeds | correct identities | switches | fragments | recall, % | longest ghost, frames | MPJPE, mm "
    "| inside 68 / 95 % region | NEES | jitter ratio | ms/frame | baseline: MPJPE, mm | switches |\n"
    "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|"
)


def row(name: str, runs: Sequence[Run], others: Sequence[PeopleScores]) -> str:
    """Return one row of the table: median (worst) of the seeds."""
    scores = [run.scores for run in runs]
    beside = ["-", "-"]
    if others:
        ours, theirs = (np.mean([each.mpjpe_mm for each in of]) for of in (scores[: len(others)], others))
        beside = [
            f"{theirs:.1f}, ours {100 * (ours / theirs - 1):+.0f} %",
            _median_worst([float(each.clear[0].switches) for each in others], "{:.0f}"),
        ]
    cells = [
        name,
        str(len(runs)),
        *_common_cells(runs),
        _median_worst([each.jitter.ratio for each in scores], "{:.2f}"),
        f"{1e3 * np.median([np.median(run.frame_s) for run in runs]):.2f}",
        *beside,
    ]
    return f"| {' | '.join(cells)} |"


def _common_cells(runs: Sequence[Run]) -> list[str]:
    """Return the columns that all tables share, from identities to NEES: median (worst) of the seeds."""
    scores = [run.scores for run in runs]
    covered = [[100 * getattr(each.nees, share) for each in scores] for share in ("covered_68", "covered_95")]
    return [
        f"{sum(run.is_fine for run in runs)} of {len(runs)}",
        _median_worst([float(each.clear[0].switches) for each in scores], "{:.0f}"),
        _median_worst([float(each.clear[0].fragments) for each in scores], "{:.0f}"),
        _median_worst([100 * each.recall_after_entry for each in scores], "{:.2f}", least=True),
        _median_worst([float(_ghost(each)) for each in scores], "{:.0f}"),
        _median_worst([each.mpjpe_mm for each in scores], "{:.1f}"),
        " / ".join(_median_worst(each, "{:.0f}", least=True) for each in covered),
        _median_worst([each.nees.mean for each in scores], "{:.1f}"),
    ]


def _median_worst(values: Sequence[float], form: str, *, least: bool = False) -> str:
    worst = min(values) if least else max(values)
    return f"{form.format(float(np.median(values)))} ({form.format(worst)})"


def scenes(names: Sequence[str], seeds: int, baseline_seeds: int) -> None:
    """Print the table of scenes, each row when it is complete, and then the remarks."""
    print(HEAD, flush=True)
    remarks: list[str] = []
    for name in names:
        runs, others = [], []
        for seed in range(seeds):
            _say(f"{name}, seed {seed}")
            scene = scene_of(scenario_of(name, seed))
            runs.append(follow(scene, tracker_for(scene, TrackerOptions())))
            if seed < baseline_seeds:
                others.append(baseline(scene))
        _say("")
        print(row(name, runs, others), flush=True)
        remarks += _remarks(name, runs)
    print("\n".join(remarks))


def _remarks(name: str, runs: Sequence[Run]) -> list[str]:
    """Return remarks on failed seeds, identity events and rejected cameras."""
    said = [f"{name}: failed seeds: {[seed for seed, run in enumerate(runs) if not run.is_fine]}"]
    if name in ("hug", "equal"):
        for what in ("possible_identity_switch", "identities_swapped"):
            n = sum(any(event.what == what for event in run.events) for run in runs)
            said.append(f"{name}: {what!r} is reported in {n} of {len(runs)}")
    if name == "one_camera":
        said.append(f"{name}: {_single_view_remark([run.alone for run in runs])}")
    if any(run.moved for run in runs):
        named = sum(run.refused == (run.moved,) for run in runs)
        said.append(f"{name}: only the camera that moved is rejected in {named} of {len(runs)}")
    elif any(run.refused for run in runs):
        said.append(f"{name}: static cameras are rejected in {sum(bool(run.refused) for run in runs)}")
    return said


def _single_view_remark(all_runs: Sequence[Alone]) -> str:
    off, sd, squared = (np.concatenate([getattr(a, part) for a in all_runs]) for part in ("off_m", "sd_m", "squared"))
    inside = [100 * np.mean(squared <= chi2.ppf(share, 3)) for share in (0.68, 0.95)]
    return (
        f"in {len(off)} frames a single view observes a person: {off.mean():+.2f} m along its ray, "
        f"{np.sqrt((off**2).mean()):.2f} m rms, estimated as {np.sqrt((sd**2).mean()):.2f} m; "
        f"inside the 68 / 95 % region {inside[0]:.0f} / {inside[1]:.0f} %"
    )


@dataclass(frozen=True)
class Ablation:
    """Variant of the tracker without one of its parts, or with another one.

    Attributes:
        what: Label of the row.
        options: Options of the tracker.
        components: Components that are replaced by those of the strategy `specification`.
        shape_spread: Factor for the variance of bone lengths in the prior.
        smoothed: Whether the smoothed results are scored.
        scenarios: Scenes of the rows.
    """

    what: str
    options: TrackerOptions = field(default_factory=TrackerOptions)
    components: tuple[str, ...] = ()
    shape_spread: float = 1.0
    smoothed: bool = False
    scenarios: tuple[Scenario, ...] = ("crowd", "hug")

    def follow(self, scene: CrowdScene) -> Run:
        """Track all people of a scene."""
        tracker = tracker_for(scene, self.options)
        setup, other = tracker.setup, find_strategy("specification")
        tree = setup.settings.tree
        wide = replace(tree, shape_covariance=self.shape_spread * tree.shape_covariance)
        tracker.setup = replace(
            setup,
            strategy=replace(setup.strategy, **{name: getattr(other, name) for name in self.components}),
            settings=replace(setup.settings, tree=wide),
        )
        return follow(scene, tracker, smoothed=self.smoothed)


STAGES = tuple(name for name, value in vars(TrackerOptions()).items() if hasattr(value, "enabled"))
"""Stages of the tracker that an option turns off."""


def without_stage(name: str) -> TrackerOptions:
    """Return the default options with one stage off."""
    options = TrackerOptions()
    return replace(options, **{name: replace(getattr(options, name), enabled=False)})


def without_terms(changed: dict[str, float | bool | None]) -> TrackerOptions:
    """Return the options of the strategy `specification` with some of its terms off."""
    return TrackerOptions(strategy="specification", specification=replace(TrackerOptions().specification, **changed))


_BOTH: tuple[Scenario, ...] = ("crowd", "hug")
TERMS: tuple[tuple[str, tuple[Scenario, ...], dict[str, float | bool | None]], ...] = (
    ("`pair_proposals` false", _BOTH, {"pair_proposals": False}),
    ("`angle_weight` 0", _BOTH, {"angle_weight": 0.0}),
    ("`anthropometric_weight` 0", _BOTH, {"anthropometric_weight": 0.0}),
    ("`normalized_distance` true", _BOTH, {"normalized_distance": True}),
    ("`tentative_motion` false", _BOTH, {"tentative_motion": False}),
    ("`promotion_fit` false", _BOTH, {"promotion_fit": False}),
    ("`shape_gain` off", _BOTH, {"shape_gain": None}),
    ("`core_matching` false", _BOTH, {"core_matching": False}),
    ("`same_frame_reacquisition` false", ("crowd", "hug", "leave"), {"same_frame_reacquisition": False}),
    ("`twist_motion` false", _BOTH, {"twist_motion": False}),
    ("`persistent_velocities` false", ("crowd", "hug", "leave"), {"persistent_velocities": False}),
    ("`terminate_variance_m2` off", ("leave",), {"terminate_variance_m2": None}),
    ("`terminate_outside_after_s` off", ("leave",), {"terminate_outside_after_s": None}),
    ("neither rule of termination", ("leave",), {"terminate_variance_m2": None, "terminate_outside_after_s": None}),
)
"""Terms of the specification that an option switches: the label of the row, its scenes and the changed options."""

ABLATIONS = (
    Ablation("defaults, causal", scenarios=("crowd", "hug", "leave")),
    Ablation("with the smoother (offline)", smoothed=True),
    *(Ablation(f"`{name}.enabled` false", without_stage(name)) for name in STAGES),
    Ablation("Gaussian errors (`nu` 1e6)", TrackerOptions(nu=1e6)),
    Ablation("no gates (`gate` 1e12)", TrackerOptions(gate=1e12)),
    Ablation("uncorrelated errors (`error_memory_s` 1e-6)", TrackerOptions(error_memory_s=1e-6)),
    Ablation("no swaps (`swap_log_odds` -1e6)", TrackerOptions(swap_log_odds=-1e6)),
    Ablation("wide prior of bone lengths (variance x 25)", shape_spread=_WIDE),
    Ablation(
        "`strategy` specification",
        TrackerOptions(strategy="specification"),
        scenarios=("crowd", "hug", "leave"),
    ),
    *(
        Ablation(f"only its {what}", components=(name,))
        for name, what in (
            ("score", "scores"),
            ("noise", "noise recursion"),
            ("prior", "prior"),
            ("distance", "distance of proposals"),
            ("motion", "motion"),
            ("initiation", "first body"),
        )
    ),
    *(
        Ablation(f"`specification`, {what}", without_terms(changed), scenarios=scenarios)
        for what, scenarios, changed in TERMS
    ),
)

ABLATION_HEAD = (
    "| | scene | correct identities | switches | fragments | recall, % | longest ghost, frames | MPJPE, mm "
    "| inside 68 / 95 % region | NEES |\n|---|---|---|---|---|---|---|---|---|---|"
)


def ablations(seeds: int) -> None:
    """Print the effect of each part."""
    print(ABLATION_HEAD)
    for each in ABLATIONS:
        for scenario in each.scenarios:
            scene = CrowdOptions(scenario)
            if scenario == "crowd":
                scene = replace(scene, duration_s=_ABLATED_CROWD_S)
            runs = []
            for seed in range(seeds):
                _say(f"{each.what}, {scene.scenario} {seed}")
                runs.append(each.follow(scene_of(replace(scene, seed=seed))))
            _say("")
            print(ablation_row(each.what, scene.scenario, runs), flush=True)


def ablation_row(what: str, scene: str, runs: Sequence[Run]) -> str:
    """Return one row of the table: median (worst) of the seeds."""
    return f"| {' | '.join([what, scene, *_common_cells(runs)])} |"


def _say(what: str) -> None:
    print(f"\r{what:60}", end="" if what else "\r", file=sys.stderr, flush=True)


def main() -> None:
    """Print all tables, or the selected ones."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default=",".join((*_NAMES, "ablations")))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--baseline-seeds", type=int, default=3)
    parser.add_argument("--ablation-seeds", type=int, default=3)
    chosen = parser.parse_args()
    only = chosen.only.split(",")
    unknown = sorted(set(only) - {*_NAMES, "ablations"})
    if unknown:
        parser.error(f"no {unknown}; there are {', '.join((*_NAMES, 'ablations', 'speed'))}")
    names = [name for name in _NAMES if name in only]
    if names:
        scenes(names, chosen.seeds, chosen.baseline_seeds)
    if "ablations" in only:
        ablations(chosen.ablation_seeds)


if __name__ == "__main__":
    main()
