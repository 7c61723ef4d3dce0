"""Simulated crowds seen by cameras with clocks of their own, and who is on each track."""

from dataclasses import dataclass, replace

import numpy as np

import posefuse
from posefuse.calibration.people.tracks import tracks_in_views
from posefuse.calibration.people.views import PeopleViews, ViewTracks
from posefuse.model.cameras import CameraRig
from posefuse.synthetic.crowds import simulate_crowd


@dataclass(frozen=True, eq=False)
class CrowdViews:
    """The tracks of a simulated crowd and the truth.

    Attributes:
        people: tracks of each view.
        owner: by view, the person of most detections of each track, -1 for a false one.
        rig: true cameras.
        offset_s: shape (view,): true time minus timestamp.
    """

    people: PeopleViews
    owner: list[list[int]]
    rig: CameraRig
    offset_s: np.ndarray


def crowd_views(seed: int, *, people: int = 3, cameras: int = 3, duration_s: float = 15.0) -> CrowdViews:
    """Simulate people who walk through each other's paths; views start up to a second apart."""
    scene = simulate_crowd(posefuse.CrowdOptions(people=people, cameras=cameras, duration_s=duration_s, seed=seed))
    offset_s = np.round(np.random.default_rng(seed).uniform(-1.0, 1.0, cameras) * 25.0) / 25.0
    detections = replace(scene.detections, time_s=scene.detections.time_s - offset_s)
    views = tracks_in_views(detections, scene.rig.cameras)
    owner = [_owners(scene, views.views[v], v) for v in range(cameras)]
    return CrowdViews(views, owner, scene.rig, offset_s)


def _owners(scene, view: ViewTracks, index: int) -> list[int]:
    found = []
    for track in range(view.keypoints_px.shape[1]):
        votes = np.zeros(2 + int(scene.owner.max()), dtype=int)
        for f in np.flatnonzero(np.isfinite(view.keypoints_px[:, track, :, 0]).any(axis=1)):
            cell = f * scene.detections.n_views + index
            for row in range(scene.detections.offsets[cell], scene.detections.offsets[cell + 1]):
                if np.array_equal(scene.detections.keypoints_px[row], view.keypoints_px[f, track], equal_nan=True):
                    votes[scene.owner[row] + 1] += 1
        found.append(int(votes.argmax()) - 1)
    return found
