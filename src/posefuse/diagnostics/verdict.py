"""Judge poses and clocks of an examined recording by the joint estimate; all commands present this verdict."""

from dataclasses import dataclass

import numpy as np

from posefuse.calibration.joint.asynchrony import log_odds_of_free_running
from posefuse.calibration.joint.equations import linearize
from posefuse.calibration.joint.estimate import JointEstimate, estimate, sample_frames
from posefuse.calibration.joint.evidence import (
    CLOCK_KINDS,
    DECISIVE,
    DRIFT_SD,
    POSE_KINDS,
    Choice,
    Comparison,
    Explanation,
    choose,
)
from posefuse.calibration.joint.extent import PoseUnits
from posefuse.calibration.joint.left_out import gain_by_offsets
from posefuse.calibration.joint.parameters import JointParameters
from posefuse.calibration.joint.recording import JointRecording
from posefuse.diagnostics.coarse_search import CoarseResult
from posefuse.diagnostics.fine_result import FineResult
from posefuse.diagnostics.frame_rates import growth
from posefuse.diagnostics.joint_recording import joint_recording
from posefuse.diagnostics.observations import TrackedObservations
from posefuse.kernels.calibration.joint import VIEW_PARAMETERS

_UNIT_FRAMES = 100
_MIN_KEYPOINTS = 4
"""A few keypoints that linger do not show how much of their errors lasts, so nothing is judged by them."""
_NARROW_SHARE, _FREE_SHARE = 0.25, 5.0
_LATE_SD_S, _SYNCHRONIZED_SD_S = 1.0, 0.06
"""Standard deviations of the time offsets of views with a gross offset, and of others: the coarse search finds larger
ones, and where people hardly move, the estimate would run away."""
_DRIFT_PRIOR_SD = 5e-4
"""A drift of more than 500 ppm is a frame-rate error or none."""
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
        units: sizes of usual faults of the poses.
        late_sd_s: shape (view,): prior standard deviation of the time offset.
        rate_error: shape (view,): gross relative errors of the frame rates, not part of ``change``.
        rate_middle_s: time at which these errors do not shift the view.
        free_running: log of the odds that all clocks differ as those of cameras without a common trigger.
    """

    estimate: JointEstimate
    choices: tuple[Choice, ...]
    change: np.ndarray
    sd: np.ndarray
    steps_s: np.ndarray
    recording: JointRecording
    max_samples: int
    units: PoseUnits
    late_sd_s: np.ndarray
    rate_error: np.ndarray
    rate_middle_s: float
    free_running: float

    @property
    def is_free_running(self) -> bool:
        """Return whether the cameras have no common trigger, and their timestamps do not show it."""
        return self.free_running >= DECISIVE

    def slope(self, view: int, drift: float) -> float:
        """Return the change of a view's time offset per second of true time, by a drift and by its frame rate."""
        rate = growth(float(self.rate_error[view]))
        return rate + drift * (1.0 - rate)

    def offsets_s(self, view: int, time_s: np.ndarray, offset_s: float, drift: float) -> np.ndarray:
        """Return a view's time offset at the samples, shape (sample,).

        Args:
            view: index of the view.
            time_s: shape (sample,): true times of the samples.
            offset_s: offset in the middle of the recording, after correction of the frame rate.
            drift: likewise.
        """
        rate = growth(float(self.rate_error[view]))
        corrected = offset_s + drift * (time_s - self.estimate.middle_s) + self.steps_s[:, view]
        return rate * (time_s - self.rate_middle_s) + (1.0 - rate) * corrected

    def of(self, view: int, kinds: tuple[str, ...]) -> tuple[Choice, ...]:
        """Return the accepted explanations of some kinds about a view."""
        return tuple(c for c in self.choices if c.explanation.view == view and c.explanation.kind in kinds)

    def clocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Return offsets and drifts of all clocks, shape (view, 2), given the accepted poses, and their covariance.

        Poses are estimated again with a narrow prior unless they were found wrong, drifts likewise.
        """
        joint, has_drift = self._estimate_clocks()
        n = len(joint.names)
        at = [VIEW_PARAMETERS * v + p for p in (6, 7) for v in range(n)]
        drift = joint.change[:, 7:] if has_drift else np.zeros((n, 1))
        return np.hstack([joint.change[:, 6:7], drift]), joint.covariance[np.ix_(at, at)]

    def gain_by_offsets(self, common: np.ndarray) -> np.ndarray:
        """Return by how much the time offset of each view improves its prediction by the other views, shape (view,).

        Offsets from each half of the recording are applied to the other half.

        Args:
            common: shape (view,): weights of the clocks that define the common one.

        Returns:
            Decrease of the loss; NaN where the other views predict too little.
        """
        first, second = np.array_split(sample_frames(self.recording, self.max_samples), 2)
        gains = np.zeros(len(self.estimate.names))
        for used, predicted in ((first, second), (second, first)):
            joint, _ = self._estimate_clocks(used)
            offset_s = joint.change[:, 6] - common @ joint.change[:, 6]
            gains += gain_by_offsets(self.recording, predicted, joint.parameters, joint.noise_scale, offset_s)
        return gains

    def _estimate_clocks(self, frames: np.ndarray | None = None) -> tuple[JointEstimate, bool]:
        """Return the estimate from some frames given the accepted poses, and whether a clock drifts."""
        n = len(self.estimate.names)
        prior_sd = _prior_sd(self.units, self.late_sd_s, _NARROW_SHARE)
        prior_sd[:, 7] = DRIFT_SD
        wide_sd = _prior_sd(self.units, np.full(n, _LATE_SD_S))
        for choice in self.choices:
            at = slice(0, 6) if choice.explanation.kind in POSE_KINDS else slice(6, 8)
            prior_sd[choice.explanation.view, at] = wide_sd[choice.explanation.view, at]
        if not any(choice.explanation.kind in ("drift", "rate") for choice in self.choices):
            prior_sd[:, 7] = _NO_DRIFT
        joint = estimate(self.recording, self.estimate.parameters, self.max_samples, prior_sd, frames)
        return joint or self.estimate, bool(prior_sd[0, 7] > _NO_DRIFT)

    def pose_sds(self) -> dict[str, tuple[float, float]]:
        """Return standard deviations of the pose of every camera, if all poses are unknown: in degrees and in m.

        They allow for errors that last for seconds, and are given in the least certain direction.
        """
        prior_sd = _prior_sd(self.units, self.late_sd_s, _FREE_SHARE)
        joint = estimate(self.recording, self.estimate.parameters, self.max_samples, prior_sd) or self.estimate
        out = {}
        for v, name in enumerate(joint.names):
            first = v * VIEW_PARAMETERS
            parts = (joint.covariance[a : a + 3, a : a + 3] for a in (first, first + 3))
            rotation, center_m = (float(np.sqrt(max(np.linalg.eigvalsh(part)[-1], 0.0))) for part in parts)
            out[name] = float(np.degrees(rotation)), center_m
        return out


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
    rate_error = np.zeros(observations.n_views)
    for correction in coarse.corrections:
        if correction.kind == "rate":
            rate_error[correction.view] = (1.0 + rate_error[correction.view]) * (1.0 + correction.rate_error) - 1.0
    recording, start = joint_recording(observations, model, poses, steps, bumped, rate_error)
    units = _units(recording, start)
    late_sd_s = np.full(observations.n_views, _SYNCHRONIZED_SD_S)
    late_sd_s[_late_views(coarse, observations.n_views)] = _LATE_SD_S
    joint = None if units is None else estimate(recording, start, max_samples, _prior_sd(units, late_sd_s))
    if joint is None or units is None:
        return None
    checked = fine.final.system.n_checked > 0
    checked &= len(observations.keypoint_index) >= _MIN_KEYPOINTS
    choices = tuple(c for c in choose(joint, (*given, *bumped)) if checked[c.explanation.view])
    explanations = tuple(c.explanation for c in choices)
    change, covariance = Comparison(joint).posterior(explanations)
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0)).reshape(change.shape)
    middle_s = float(0.5 * (observations.frame_time_s[0] + observations.frame_time_s[-1]))
    free = float("-inf")
    if np.sum(checked) > 1:
        free = log_odds_of_free_running(joint, explanations, observations.period_s)
    return Verdict(
        joint, choices, change, sd, steps, recording, max_samples, units, late_sd_s, rate_error, middle_s, free
    )


def _units(recording: JointRecording, start: JointParameters) -> PoseUnits | None:
    """Return the units of pose errors, or None without points that two views observe."""
    rows = linearize(recording, sample_frames(recording, _UNIT_FRAMES), start, np.ones(recording.n_views))
    return PoseUnits.of(rows) if rows.seen.any() else None


def _prior_sd(units: PoseUnits, late_sd_s: np.ndarray, share: float = 1.0) -> np.ndarray:
    """Return the prior standard deviations of all changes, shape (view, parameter)."""
    pose = [share * units.rotation] * 3 + [share * units.center_m] * 3
    return np.array([[*pose, late_s, _DRIFT_PRIOR_SD] for late_s in late_sd_s])


def _late_views(coarse: CoarseResult, n_views: int) -> list[int]:
    """Return the views with a gross time offset."""
    views = {c.view for c in coarse.corrections if c.kind in ("offset", "rate")}
    return list(range(n_views)) if -1 in views else sorted(views)


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
        "shift": "a shift",
        "pose": "another pose",
    }[explanation.kind]
    return f"{what} of {names[explanation.view]!r}"
