"""Baseline tracker: proposals in every frame, linked in 3D, with a Kalman filter per keypoint.

Proposals follow RapidPoseTriangulation (association method ``rpt``) and are linked one to one to the nearest predicted
pose. The filter assumes constant velocity with accelerations of 2 m/s^2, as in the reference measurements. The error of
a point comes from its proposal, times a factor tuned in favor of the baseline: on the first 16 s of
the scene "crowd", seed 0, 1.0 gives 80 mm, 0.5 73 mm and 0.3 72.0 mm; accelerations of 5 to 40 m/s^2 with factors of
0.3 to 1.0 give 71.8 mm at best.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from posefuse.association.proposals import propose
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions, RptOptions

ACCELERATION_M_S2 = 2.0
_GATE_M = 0.5
_KEPT_S = 0.4
_CONFIRMED_FRAMES = 3
_FIRST_SPEED_M_S = 1.5
_MIN_SD_M = 0.01
_ERROR_FACTOR = 0.3
_FAR = 1e6


@dataclass(eq=False)
class _Track:
    """A track with one filter per keypoint, shared by the three axes.

    Attributes:
        name: name of the person.
        points_m: shape (keypoint, 3), NaN before the first observation.
        velocity_m_s: shape (keypoint, 3).
        covariance: shape (keypoint, 2, 2): covariance of position and velocity along any axis.
        seen_s: time of the last observation.
        frames: number of frames with an observation.
    """

    name: str
    points_m: np.ndarray
    velocity_m_s: np.ndarray
    covariance: np.ndarray
    seen_s: float
    frames: int = 1

    def predict(self, dt_s: float) -> None:
        """Predict the state after a time step."""
        self.points_m = self.points_m + dt_s * self.velocity_m_s
        step = np.array([[1.0, dt_s], [0.0, 1.0]])
        gain = np.array([0.5 * dt_s**2, dt_s])
        self.covariance = step @ self.covariance @ step.T + ACCELERATION_M_S2**2 * np.outer(gain, gain)

    def update(self, points_m: np.ndarray, variance_m2: np.ndarray) -> None:
        """Update with the points of a frame, shapes (keypoint, 3) and (keypoint,), NaN if missing."""
        new = np.isnan(self.points_m[:, 0]) & np.isfinite(points_m[:, 0])
        self._begin(new, points_m, variance_m2)
        seen = np.isfinite(points_m[:, 0]) & ~new
        gain = self.covariance[seen, :, 0] / (self.covariance[seen, 0, 0] + variance_m2[seen])[:, None]
        off = points_m[seen] - self.points_m[seen]
        self.points_m[seen] += gain[:, :1] * off
        self.velocity_m_s[seen] += gain[:, 1:] * off
        self.covariance[seen] -= gain[:, :, None] * self.covariance[seen, :1]

    def _begin(self, new: np.ndarray, points_m: np.ndarray, variance_m2: np.ndarray) -> None:
        self.points_m[new], self.velocity_m_s[new] = points_m[new], 0.0
        self.covariance[new] = 0.0
        self.covariance[new, 0, 0], self.covariance[new, 1, 1] = variance_m2[new], _FIRST_SPEED_M_S**2


@dataclass(eq=False)
class _Linker:
    """All tracks of the baseline."""

    tracks: list[_Track] = field(default_factory=list)
    names: int = 0

    def take(self, points_m: np.ndarray, variance_m2: np.ndarray, time_s: float, dt_s: float) -> None:
        """Assign the nearest proposal to each track; unassigned proposals start new tracks."""
        for track in self.tracks:
            track.predict(dt_s)
        self.tracks = [track for track in self.tracks if time_s - track.seen_s <= _KEPT_S]
        left = set(range(len(points_m)))
        for t, p in self._pairs(points_m):
            self.tracks[t].update(points_m[p], variance_m2[p])
            self.tracks[t].seen_s, self.tracks[t].frames = time_s, self.tracks[t].frames + 1
            left.discard(p)
        for p in sorted(left):
            self.names += 1
            k = len(points_m[p])
            track = _Track(
                f"person_{self.names}", np.full((k, 3), np.nan), np.zeros((k, 3)), np.zeros((k, 2, 2)), time_s
            )
            track.update(points_m[p], variance_m2[p])
            self.tracks.append(track)

    def _pairs(self, points_m: np.ndarray) -> list[tuple[int, int]]:
        cost = np.full((len(self.tracks), len(points_m)), _FAR)
        for t, track in enumerate(self.tracks):
            apart = np.linalg.norm(points_m - track.points_m, axis=-1)
            common = np.isfinite(apart)
            mean = np.where(common, apart, 0.0).sum(axis=1) / np.maximum(common.sum(axis=1), 1)
            cost[t] = np.where(common.any(axis=1) & (mean < _GATE_M), mean, _FAR)
        return [(int(t), int(p)) for t, p in zip(*linear_sum_assignment(cost), strict=True) if cost[t, p] < _FAR]


def follow(rig: CameraRig, detections: Detections, noise: NoiseModel) -> tuple[tuple[str, ...], np.ndarray]:
    """Track all people in a recording, causally.

    Args:
        rig: the cameras.
        detections: with times.
        noise: of the detections.

    Returns:
        Names, and shape (frame, person, keypoint, 3), NaN before a track is confirmed and while it is absent.
    """
    options = AssociationOptions(method="rpt", rpt=RptOptions(min_pairs=2))
    linker, before_s = _Linker(), np.nan
    told: list[dict[str, np.ndarray]] = []
    for i in range(detections.n_frames):
        frame = Frame.of(detections, i)
        found = propose(rig, frame, noise, detections.skeleton, np.ones(len(frame.view), dtype=bool), options)
        variance = found.covariance_m2[:, :, (0, 3, 5)].mean(axis=-1)
        variance = np.maximum(_ERROR_FACTOR**2 * variance, _MIN_SD_M**2)
        time_s = float(np.nanmean(frame.time_s))
        linker.take(found.points_m, variance, time_s, 0.0 if np.isnan(before_s) else time_s - before_s)
        before_s = time_s
        told.append({t.name: t.points_m.copy() for t in linker.tracks if t.frames >= _CONFIRMED_FRAMES})
    names = tuple(dict.fromkeys(name for frame in told for name in frame))
    points = np.full((len(told), len(names), len(detections.skeleton), 3), np.nan)
    place = {name: p for p, name in enumerate(names)}
    for f, people in enumerate(told):
        for name, pose in people.items():
            points[f, place[name]] = pose
    return names, points
