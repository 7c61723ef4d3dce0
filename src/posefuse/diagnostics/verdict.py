"""Judge poses and clocks of an examined recording by the joint estimate; all commands present this verdict."""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.joint.estimate import PRIOR_SD, JointEstimate, estimate
from posefuse.calibration.joint.evidence import (
    CLOCK_KINDS,
    DRIFT_SD,
    POSE_KINDS,
    Choice,
    Comparison,
    Explanation,
    choose,
)
from posefuse.calibration.joint.recording import JointRecording
from posefuse.diagnostics.coarse_search import CoarseResult
from posefuse.diagnostics.fine_result import FineResult
from posefuse.diagnostics.joint_recording import joint_recording
from posefuse.diagnostics.observations import TrackedObservations
from posefuse.kernels.calibration.joint import VIEW_PARAMETERS

_WIDE_SD = np.array([*PRIOR_SD[:7], 5e-4])
"""Prior of what may be wrong; a drift of more than 500 ppm is a frame-rate error or none."""
_NARROW_SD = np.array([np.radians(0.25)] * 3 + [0.01] * 3 + [PRIOR_SD[6], DRIFT_SD])
_NO_DRIFT = 1e-7


@dataclass(frozen=True, eq=False)
class Verdict:
    """Hold the joint estimate of poses and clocks, and which of them are wrong.

    Attributes:
        estimate: of all views.
        choices: accepted explanations, the first accepted first.
        change: shape (view, parameter): changes under the accepted explanations.
        sd: shape (view, parameter): their standard deviations.
        steps_s: shape (sample, view): changes of the time offset by dropped frames, without their mean.
        recording: the keypoints it was estimated from.
        max_samples: largest number of frames used.
    """

    estimate: JointEstimate
    choices: tuple[Choice, ...]
    change: np.ndarray
    sd: np.ndarray
    steps_s: np.ndarray
    recording: JointRecording
    max_samples: int

    def of(self, view: int, kinds: tuple[str, ...]) -> tuple[Choice, ...]:
        """Return the accepted explanations of some kinds about a view."""
        return tuple(c for c in self.choices if c.explanation.view == view and c.explanation.kind in kinds)

    def clocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Return offsets and drifts of all clocks, shape (view, 2), given the accepted poses, and their covariance.

        Poses are estimated again with a narrow prior unless they were found wrong, drifts likewise.
        """
        n = len(self.estimate.names)
        prior_sd = np.tile(_NARROW_SD, (n, 1))
        for choice in self.choices:
            at = slice(0, 6) if choice.explanation.kind in POSE_KINDS else slice(6, 8)
            prior_sd[choice.explanation.view, at] = _WIDE_SD[at]
        if not any(choice.explanation.kind in ("drift", "rate") for choice in self.choices):
            prior_sd[:, 7] = _NO_DRIFT
        joint = estimate(self.recording, self.estimate.parameters, self.max_samples, prior_sd) or self.estimate
        at = [VIEW_PARAMETERS * v + p for p in (6, 7) for v in range(n)]
        drift = joint.change[:, 7:] if prior_sd[0, 7] > _NO_DRIFT else np.zeros((n, 1))
        return np.hstack([joint.change[:, 6:7], drift]), joint.covariance[np.ix_(at, at)]


def judge(
    observations: TrackedObservations, coarse: CoarseResult, fine: FineResult, max_samples: int
) -> Verdict | None:
    """Estimate poses and clocks jointly from the corrections found, and compare explanations of their changes.

    Args:
        observations: of the recording.
        coarse: gross faults; poses that they replaced count as given.
        fine: small faults; bumps, dropped frames and lens faults count as given.
        max_samples: largest number of frames to use.
    """
    model, blocks = fine.final.model, fine.final.system.block_index
    steps = np.zeros_like(model.offset_s)
    for fault in fine.accepted:
        if fault.hypothesis.kind == "dropped":
            later = [u.profile for u in fault.hypothesis.unknowns][-1]
            steps[:, fault.hypothesis.view] += fault.values[-1] * later[blocks]
    steps -= steps.mean(axis=0)
    poses = np.stack([camera.camera_from_world for camera in observations.rig.cameras])
    given = {c.view for c in coarse.corrections if c.kind == "pose"}
    for v in range(observations.n_views):
        if v in given or model.cameras[v] != v:
            poses[v] = observations.rig.cameras[model.cameras[v]].camera_from_world
        if v in given:
            poses[v, :3, :3], poses[v, :3, 3] = model.rotation[0, v], model.translation_m[0, v]
    bumped = {
        fault.hypothesis.view: int(np.argmax(blocks >= fault.hypothesis.since_block))
        for fault in fine.accepted
        if fault.hypothesis.since_block is not None and fault.hypothesis.kind != "dropped"
    }
    recording, start = joint_recording(observations, model, poses, steps, bumped)
    joint = estimate(recording, start, max_samples, np.tile(_WIDE_SD, (observations.n_views, 1)))
    if joint is None:
        return None
    checked = fine.final.system.n_checked > 0
    suspected = {fault.hypothesis.view for fault in fine.accepted} - given - set(bumped)
    late = {fault.hypothesis.view for fault in fine.accepted} | _late_views(coarse, observations.n_views)
    choices = tuple(c for c in choose(joint, suspected, late) if checked[c.explanation.view])
    change, covariance = Comparison(joint).posterior(tuple(c.explanation for c in choices))
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0)).reshape(change.shape)
    return Verdict(joint, choices, change, sd, steps, recording, max_samples)


def _late_views(coarse: CoarseResult, n_views: int) -> set[int]:
    """Return the views with a gross time offset."""
    views = {c.view for c in coarse.corrections if c.kind == "offset"}
    return set(range(n_views)) if -1 in views else views


def rival_text(verdict: Verdict, choice: Choice) -> str:
    """Return a sentence that names the explanations that fit equally well, and what to film; empty without any."""
    if not choice.rivals:
        return ""
    names = verdict.estimate.names
    others = " or ".join(dict.fromkeys(_name(rival, names) for rival in choice.rivals[:2]))
    kinds = {choice.explanation.kind, *(rival.kind for rival in choice.rivals[:2])}
    clock, pose = kinds & set(CLOCK_KINDS), kinds & set(POSE_KINDS)
    if clock and pose:
        film = "To tell them apart, film a person who walks quickly across the volume in several directions."
    elif pose:
        film = "To tell them apart, film a person who walks through the whole volume."
    else:
        film = "To tell them apart, film a person who walks for at least a minute."
    return f" {others[0].upper()}{others[1:]} explains this equally well. {film}"


def _name(explanation: Explanation, names: tuple[str, ...]) -> str:
    """Return an explanation in words."""
    what = {
        "offset": "a time offset",
        "drift": "a clock drift",
        "rate": "a wrong frame rate",
        "rotation": "a rotation",
        "pose": "another pose",
    }[explanation.kind]
    return f"{what} of {names[explanation.view]!r}"
