"""Joint angles of a result: people are estimated from a sample of frames, and then all frames window by window."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from posefuse.arrays import ranges
from posefuse.biomechanics.angle_definitions import AngleSet, angle_set, angles_of
from posefuse.biomechanics.inverse_kinematics import PersonPoints, Solution, person_points, posterior_means, solve
from posefuse.biomechanics.marker_model import MarkerModel, marker_model
from posefuse.biomechanics.subject_fit import SubjectFit, systematic_covariance
from posefuse.biomechanics.tables import keypoint_angles
from posefuse.model.joint_angles import KEYPOINTS, AngleStatus, JointAngles
from posefuse.model.reconstruction import Reconstruction
from posefuse.parallel import ONE_JOB, Jobs
from posefuse.pipeline.subjects import Subjects, fit_subjects, frame_rate

_WINDOW = 512
"""Number of frames estimated at a time, whatever the chunks of the result: no window depends on another."""
_KNOT_S = 0.1
"""Interval at which the uncertainty due to a person's parameters is computed."""


def with_joint_angles(result: Reconstruction, jobs: Jobs = ONE_JOB) -> Reconstruction:
    """Return a result in memory with its joint angles, if its skeleton has any."""
    parts = list(joint_angles(result, jobs))
    return replace(result, joint_angles=JointAngles.concatenate(parts)) if parts else result


def joint_angles(result: Reconstruction, jobs: Jobs = ONE_JOB) -> Iterator[JointAngles]:
    """Yield the joint angles of consecutive ranges of frames; nothing without angles.

    A human skeleton has the coordinates of the anatomical model and ISB angles. Other skeletons, hands and faces have
    angles between segments and bones. Unrelated frames have none, because a person is estimated from several frames.

    Args:
        result: the result.
        jobs: processes that estimate the angles.

    Raises:
        OptionsError: if the static trial cannot be used.
    """
    if result.unit != "m" or not result.n_frames or not result.person_ids or not result.has_identities:
        return
    model = marker_model(result.skeleton)
    people = None if model is None else _People.of(result, model)
    windows = (_Window.of(result, people, *span) for span in ranges(result.n_frames, _WINDOW))
    yield from (angles for angles in jobs.in_order(_angles_of_window, windows) if angles.names)


@dataclass(frozen=True, eq=False)
class _Window:
    """A range of frames of which angles are estimated.

    Attributes:
        part: the frames with what angles between keypoints are computed from.
        people: the people of the result; None without an anatomical model.
        points_m: shape (frame, person, keypoint, 3): the layer of the people.
        covariance_m2: shape (frame, person, keypoint, 6).
    """

    part: Reconstruction
    people: "_People | None"
    points_m: np.ndarray
    covariance_m2: np.ndarray

    @classmethod
    def of(cls, result: Reconstruction, people: "_People | None", start: int, stop: int) -> "_Window":
        """Read a range of frames."""
        part = _only_points(result, start, stop)
        if people is None:
            return cls(part, None, np.empty(0), np.empty(0))
        layer = result.layers[people.layer_name]
        return cls(part, people, np.asarray(layer.points_m[start:stop]), np.asarray(layer.covariance_m2[start:stop]))


def _angles_of_window(window: _Window) -> JointAngles:
    """Return the angles of a range of frames; without names, if the skeleton has none."""
    people = window.people
    generic = _generic(window.part, *keypoint_angles(window.part, parts_only=people is not None))
    return generic if people is None else _joined(people.window(window.points_m, window.covariance_m2), generic)


def _only_points(result: Reconstruction, start: int, stop: int) -> Reconstruction:
    """Return a range of frames with what angles between keypoints are computed from."""
    layers = {name: layer for name, layer in result.layers.items() if name == "solved" or len(result.layers) == 1}
    layers = layers or dict([next(iter(result.layers.items()))])
    return replace(result, layers=layers, tracks=None, swaps=None, joint_angles=None).frames(start, stop)


@dataclass(frozen=True, eq=False)
class _People:
    """The people of a result, estimated from samples of frames.

    Attributes:
        angles: the angles to compute.
        layer_name: name of the layer.
        subjects: the people.
        has_vertical: whether the vertical of the world is known.
        knot_step: frames between computations of the uncertainty due to a person's parameters.
    """

    angles: AngleSet
    layer_name: str
    subjects: Subjects
    has_vertical: bool
    knot_step: int

    @classmethod
    def of(cls, result: Reconstruction, model: MarkerModel) -> "_People":
        """Estimate the people of a result."""
        name, layer = result.best_layer(result.options.layer)
        subjects = fit_subjects(result, model, layer)
        step = max(1, round(_KNOT_S * frame_rate(result)))
        has_vertical = result.rig.up is not None
        return cls(angle_set(model), name, subjects, has_vertical, step)

    def window(self, points: np.ndarray, covariance: np.ndarray) -> JointAngles:
        """Return the angles of a range of frames from points in m and their covariances."""
        each = [self._person(p, points[:, p], covariance[:, p]) for p in range(len(self.subjects.fits))]
        degrees, sds, status, pelvis = (np.stack(arrays, axis=1) for arrays in zip(*each, strict=True))
        return JointAngles(
            self.angles.names, self.angles.conventions, self.layer_name,
            degrees.astype(np.float32), sds.astype(np.float32), status, pelvis,
        )  # fmt: skip

    def _person(self, p: int, points_m: np.ndarray, covariance_m2: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return degrees, standard deviations, statuses and pelvis positions of one person."""
        fit = self.subjects.fits[p]
        person = person_points(fit.model, points_m, covariance_m2, self.subjects.verticals[p])
        solution = posterior_means(fit.model, person, solve(fit.model, person, fit.prior))
        whole = replace(solution, covariance=solution.covariance + self._systematic(fit, person, solution))
        at = [fit.model.anatomy.coordinate_index(f"pelvis_t{axis}") for axis in "xyz"]
        pelvis = np.einsum("fij,fj->fi", person.world_from_person, solution.coordinates[:, at]) + person.origin_m
        return (*angles_of(self.angles, fit.model, person, whole, self.has_vertical), pelvis)

    def _systematic(self, fit: SubjectFit, person: PersonPoints, solution: Solution) -> np.ndarray:
        """Return the covariance due to the person's parameters, interpolated between knots."""
        solved = np.flatnonzero(np.isfinite(solution.cost))
        if not len(solved):
            return np.zeros_like(solution.covariance)
        knots = np.unique([*solved[:: self.knot_step], solved[-1]])
        at_knots = Solution(*(getattr(solution, name)[knots] for name in solution.__dataclass_fields__))
        values = systematic_covariance(fit, person.rows(knots), at_knots)
        place = np.interp(np.arange(len(solution.cost)), knots, np.arange(len(knots)))
        low = np.minimum(place.astype(int), max(len(knots) - 2, 0))
        share = (place - low)[:, None, None]
        return (1.0 - share) * values[low] + share * values[np.minimum(low + 1, len(knots) - 1)]


def _generic(part: Reconstruction, names: tuple[str, ...], degrees: np.ndarray, sds: np.ndarray) -> JointAngles:
    """Return angles between keypoints."""
    status = np.where(np.isfinite(degrees), AngleStatus.OK, AngleStatus.NOT_OBSERVED).astype(np.int8)
    absent = ~np.isfinite(degrees).any(axis=2, keepdims=True)
    status = np.where(absent, np.int8(AngleStatus.ABSENT), status)
    layer = "solved" if part.poses is None else "model"
    pelvis = np.full((*degrees.shape[:2], 3), np.nan)
    return JointAngles(
        names, (KEYPOINTS,) * len(names), layer, degrees.astype(np.float32), sds.astype(np.float32), status, pelvis
    )


def _joined(body: JointAngles, parts: JointAngles) -> JointAngles:
    """Return the angles of a body and of its hands and face."""
    return replace(
        body,
        names=(*body.names, *parts.names),
        conventions=(*body.conventions, *parts.conventions),
        degrees=np.concatenate([body.degrees, parts.degrees], axis=2),
        sd_deg=np.concatenate([body.sd_deg, parts.sd_deg], axis=2),
        status=np.concatenate([body.status, parts.status], axis=2),
    )
