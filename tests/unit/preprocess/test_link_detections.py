"""Linking of the detections of a view to tracks."""

import numpy as np
import pytest

import posefuse
from posefuse.preprocess.link_detections import link_rows
from posefuse.synthetic.crowds import simulate_crowd


@pytest.mark.parametrize("track_ids", [False, True])
def test_tracks_do_not_change_their_person(track_ids):
    """The share of detections that belong to another person than most of their track, in scenes with crossings."""
    scene = simulate_crowd(
        posefuse.CrowdOptions(
            people=3, cameras=3, duration_s=20.0, seed=3, faults=posefuse.CrowdFaults(track_ids=track_ids)
        )
    )
    detections = scene.detections
    cells = np.repeat(np.arange(detections.n_frames * detections.n_views), np.diff(detections.offsets))
    wrong = kept = 0
    for view in range(3):
        rows = np.flatnonzero(cells % detections.n_views == view)
        starts = np.concatenate([[0], np.cumsum(detections.people_counts[:, view])])
        times = np.ascontiguousarray(detections.time_s[:, view])
        pixels, ids = detections.keypoints_px[rows], detections.track_ids[rows]
        track = link_rows(starts, times, np.ascontiguousarray(pixels), np.ascontiguousarray(ids), detections.skeleton)
        owner = np.asarray(scene.owner)[rows]
        for t in range(track.max() + 1):
            people = np.unique(owner[(track == t) & (owner >= 0)], return_counts=True)[1]
            wrong += people.sum() - people.max(initial=0)
            kept += people.sum() if people.sum() > 12 else 0
    assert wrong < 0.01 * kept
    assert kept > 0.6 * len(scene.owner)
