"""Contact, gait events and gait parameters on simulated recordings with known contacts.

``python -m benchmarks.gait`` reconstructs 40 walks of several speeds, statures, limps and turns, overground and on a
treadmill, from five cameras with the errors of a current detector (``rtmpose``, an assumption), or with those measured
on OpenPose (``--noise measured``), stairs, and 20 recordings without gait. ``--contact off`` leaves contact out of the
solve.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from posefuse.biomechanics.foot_paths import foot_paths
from posefuse.biomechanics.gait import Gait
from posefuse.biomechanics.gait_events import steps_of, strides_of
from posefuse.biomechanics.gait_parameters import mean_of
from posefuse.model.options.options import Options, Switch
from posefuse.pipeline.gait import analyze_gait
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.synthetic.gait_motions import GaitMotion, Stances
from posefuse.synthetic.gait_plans import WalkPlan, stand, walk
from posefuse.synthetic.gait_scenes import GaitSceneOptions, simulate_gait
from posefuse.synthetic.options import DetectorOptions, NoiseLaw

RATE_HZ = 60.0
N_WALKS, N_OTHERS, N_STAIRS = 40, 20, 6
LAWS: dict[str, DetectorOptions] = {
    "rtmpose": DetectorOptions("rtmpose", outlier_share=0.005, miss_share=0.01, swap_share=0.0015),
    "measured": DetectorOptions("measured"),
    "gaussian": DetectorOptions("gaussian", 1.0, outlier_share=0.0, miss_share=0.0, swap_share=0.0),
}


@dataclass(frozen=True)
class Case:
    """A simulated recording.

    Attributes:
        name: kind of the recording.
        motion: motion with known contacts.
        duration_s: duration.
        options: options of the scene.
        plan: plan of a walk, None for recordings without gait.
    """

    name: str
    motion: GaitMotion
    duration_s: float
    options: GaitSceneOptions
    plan: WalkPlan | None = None


@dataclass(frozen=True)
class Score:
    """Errors of one recording.

    Attributes:
        contact: true positives, false positives and false negatives of contact, in points and frames.
        strikes_s: errors of heel strikes; infinite where missing.
        offs_s: errors of toe-offs; infinite where missing.
        extra: number of events that are none.
        step_m: error of the mean step length, NaN without steps.
        cadence: relative error of the cadence.
        stance_m_s: speeds of points that rest.
        landing: largest vertical speed in the 0.07 s before a point touches, relative to the truth.
    """

    contact: tuple[int, int, int]
    strikes_s: np.ndarray
    offs_s: np.ndarray
    extra: int
    step_m: float
    cadence: float
    stance_m_s: np.ndarray
    landing: np.ndarray


def walks(n: int, law: NoiseLaw) -> Iterator[Case]:
    """Yield walks: every fifth limps, every fourth turns, every eighth is on a treadmill."""
    rng = np.random.default_rng(7)
    for i in range(n):
        speed = float(rng.uniform(0.7, 1.8))
        stride_s = float(1.1 * (speed / 1.3) ** -0.4 * rng.uniform(0.95, 1.05))
        plan = WalkPlan(speed, stride_s, float(rng.uniform(0.6, 0.64)), 6, limp=0.05 if i % 5 == 4 else 0.0)
        name = "walk"
        if i % 8 == 7:
            plan, name = replace(plan, treadmill=True), "treadmill"
        elif i % 4 == 1:
            plan, name = replace(plan, radius_m=2.0, start_m=(0.0, -2.0)), "turn"
        else:
            plan = replace(plan, strides=5, start_m=(-2.5 * speed * stride_s, 0.0))
        options = GaitSceneOptions(float(rng.uniform(1.5, 1.95)), rate_hz=RATE_HZ, seed=i, detector=LAWS[law])
        yield Case(name, walk(plan), plan.duration_s, options, plan)


def others(n: int, law: NoiseLaw) -> Iterator[Case]:
    """Yield recordings without gait: standing, squats, jumps and sliding feet."""
    motions = {
        "stand": stand(6.0),
        "squats": stand(6.0, drops=((0.8, 1.6, 0.35), (3.2, 1.8, 0.4))),
        "jumps": stand(6.0, flights=((2.0, 0.4), (4.4, 0.5))),
        "slides": stand(6.0, slides=((1.0, 0.5, 0.3), (2.0, 0.6, -0.3), (3.5, 0.5, 0.25), (4.5, 0.7, -0.25))),
    }
    for i in range(n):
        name = list(motions)[i % len(motions)]
        yield Case(name, motions[name], 6.0, GaitSceneOptions(1.6 + 0.02 * i, seed=100 + i, detector=LAWS[law]))


def stairs(n: int, law: NoiseLaw) -> Iterator[Case]:
    """Yield walks up and down stairs, toes first."""
    for i in range(n):
        rng = np.random.default_rng(300 + i)
        rise = 0.17 if i % 2 == 0 else -0.17
        plan = WalkPlan(float(rng.uniform(0.4, 0.6)), float(rng.uniform(1.2, 1.5)), strides=4, stair_m=rise)
        options = GaitSceneOptions(float(rng.uniform(1.5, 1.95)), rate_hz=RATE_HZ, seed=300 + i, detector=LAWS[law])
        yield Case("stairs", walk(plan), plan.duration_s, options, plan)


def run(case: Case, contact: Switch = "on") -> Score:
    """Reconstruct a recording, analyze its person, and compare both with the truth."""
    scene = simulate_gait(case.motion, case.duration_s, case.options)
    result = reconstruct(scene.rig, scene.detections, Options(contact=contact, layer="solved"))
    gait = analyze_gait(result)
    assert gait is not None
    feet = [
        foot_paths([each], layer, (0.0, 0.0, 1.0))[0].feet_m
        for each, layer in ((result, "solved"), (scene.truth, "measured"))
    ]
    return score(case, gait.people[next(iter(gait.people))], *feet)


def _foot_speeds(case: Case, feet_m: np.ndarray, true_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the speeds of resting points, and the vertical speeds before they touch relative to the truth."""
    contact = case.motion.contact(np.arange(len(true_m)) / RATE_HZ)
    speed, true_speed = (np.linalg.norm(each[2:] - each[:-2], axis=-1) * RATE_HZ / 2.0 for each in (feet_m, true_m))
    rests = contact[1:-1] & contact[2:] & contact[:-2] & (true_speed < 0.005)
    ratios = []
    for f, side, part in np.argwhere(~contact[:-1] & contact[1:]):
        if 6 < f < len(contact) - 6:
            found, true = (np.abs(np.diff(each[f - 4 : f + 1, side, part, 2])).max() for each in (feet_m, true_m))
            ratios.append(found / true)
    return speed[rests], np.array(ratios)


def score(case: Case, gait: Gait, feet_m: np.ndarray, true_m: np.ndarray) -> Score:
    """Compare the analysis with the known contacts.

    Args:
        case: the recording.
        gait: analysis of its person.
        feet_m: paths of the feet, shape (frame, side, part, 3).
        true_m: true paths.
    """
    time_s = np.arange(round(case.duration_s * RATE_HZ)) / RATE_HZ
    true, found = case.motion.contact(time_s), gait.contact.probability > 0.5
    counts = tuple(int(each.sum()) for each in (found & true, found & ~true, ~found & true))
    strikes, offs, extra = [], [], 0
    for side, foot in enumerate(case.motion.feet if case.plan is not None else ()):
        for kind, times, errors in (("heel_strike", foot.start_s, strikes), ("toe_off", foot.end_s, offs)):
            inside = times[(times > 0.2) & (times < time_s[-1] - 0.2)]
            own = np.array([each.time_s for each in gait.events if (each.kind, each.side) == (kind, side)])
            errors += [float(own[np.abs(own - t).argmin()] - t) if len(own) else np.inf for t in inside]
            extra += int(sum(np.abs(inside - t).min() > 0.2 for t in own if 0.2 < t < time_s[-1] - 0.2))
    if case.plan is None:
        extra = len(gait.events)
    step_m, cadence = _parameter_errors(case, gait)
    stance_m_s, landing = _foot_speeds(case, feet_m, true_m)
    return Score(counts, np.array(strikes), np.array(offs), extra, step_m, cadence, stance_m_s, landing)  # type: ignore[arg-type]


def _parameter_errors(case: Case, gait: Gait) -> tuple[float, float]:
    """Return the error of the mean step length in m and the relative error of the cadence, over the same strides."""
    step, cadence = (mean_of(gait.parameters, name) for name in ("step_length_m", "cadence_steps_min"))
    if case.plan is None or step is None or cadence is None:
        return float("nan"), float("nan")
    strikes = [each for each in gait.events if each.kind == "heel_strike" and not each.closing]
    feet = case.motion.feet
    true_s = {each: _stance(feet[each.side], each.time_s)[1] for each in strikes}
    true_m = {each: _stance(feet[each.side], each.time_s)[0] for each in strikes}
    lengths = []
    for before, strike in steps_of(gait.events):
        own = [each for each in strikes if each.side == strike.side and each.time_s < before.time_s]
        if own and own[-1].bout == strike.bout:
            along = true_m[strike] - true_m[own[-1]]
            size = float(np.linalg.norm(along))
            lengths.append(float((true_m[strike] - true_m[before]) @ along) / size if size > 0 else np.nan)
    true_cadence = 120.0 / float(np.mean([true_s[last] - true_s[first] for first, last in strides_of(gait.events)]))
    return step.value - float(np.nanmean(lengths)), cadence.value / true_cadence - 1.0


def _stance(foot: Stances, time_s: float) -> tuple[np.ndarray, float]:
    """Return the heel's place and the strike of the stance that begins nearest to a time."""
    i = int(np.abs(foot.start_s - time_s).argmin())
    return foot.place_m[i, :2], float(foot.start_s[i])


def contact_line(scores: list[Score]) -> str:
    """Return a line with the figures of contact."""
    hits, false, missed = (sum(each.contact[i] for each in scores) for i in range(3))
    stance = np.concatenate([each.stance_m_s for each in scores])
    landing = np.concatenate([each.landing for each in scores])
    text = f"contact F1 {2 * hits / (2 * hits + false + missed):.3f}"
    if len(stance):
        text += (
            f", resting feet {100 * np.nanmedian(stance):.1f} cm/s, 95 % below {100 * np.nanquantile(stance, 0.95):.1f}"
        )
    return text + (f", landing speed {100 * np.nanmedian(landing):.0f} % of the truth" if len(landing) else "")


def summarize(scores: list[Score]) -> list[str]:
    """Return lines with the figures of walks."""
    lines = [contact_line(scores)]
    for name, errors in (("heel strike", "strikes_s"), ("toe-off", "offs_s")):
        frames = np.concatenate([getattr(each, errors) for each in scores]) * RATE_HZ
        within = " / ".join(f"{100 * np.mean(np.abs(frames) <= k):.0f}" for k in (1, 2, 3))
        lines.append(
            f"{name}: {len(frames)} events, {within} % within 1 / 2 / 3 frames, median {np.median(frames):+.1f}"
        )
    steps = np.abs([each.step_m for each in scores if np.isfinite(each.step_m)])
    cadence = np.abs([each.cadence for each in scores if np.isfinite(each.cadence)])
    lines.append(f"step length: median error {1000 * np.median(steps):.0f} mm, worst {1000 * steps.max():.0f} mm")
    lines.append(f"cadence: median error {100 * np.median(cadence):.2f} %, worst {100 * cadence.max():.2f} %")
    lines.append(f"walks with parameters {len(steps)} of {len(scores)}, extra events {sum(s.extra for s in scores)}")
    return lines


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--noise", choices=tuple(LAWS), default="rtmpose")
    parser.add_argument("--walks", type=int, default=N_WALKS)
    parser.add_argument("--others", type=int, default=N_OTHERS)
    parser.add_argument("--stairs", type=int, default=N_STAIRS)
    parser.add_argument("--contact", choices=("on", "off"), default="on")
    given = parser.parse_args()
    lines = []
    for cases in (walks(given.walks, given.noise), stairs(given.stairs, given.noise)):
        scores = [(case.name, run(case, given.contact)) for case in cases]
        names = ", ".join(dict.fromkeys(name for name, _ in scores))
        lines += [f"{given.noise}, contact {given.contact}: {len(scores)} recordings ({names})"]
        lines += summarize([each for _, each in scores]) if scores else []
    still = [(case.name, run(case, given.contact)) for case in others(given.others, given.noise)]
    lines.append(f"recordings without gait: {len(still)}, with gait events: {sum(s.extra > 0 for _, s in still)}")
    for name in dict.fromkeys(name for name, _ in still):
        lines.append(f"  {name}: {contact_line([each for other, each in still if other == name])}")
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
