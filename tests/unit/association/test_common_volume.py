"""The subject stays in the common volume; passers-by are seen for longer, but by fewer cameras."""

import numpy as np
import pytest

from posefuse.association.common_volume import time_in_common_volume
from posefuse.association.one_subject import longest_subject
from posefuse.model.detections import Detections
from posefuse.model.tracks import Tracks, TrackState
from posefuse.skeleton.skeletons import find_skeleton
from tests.scenes import body_points, ring

N_FRAMES = 60


def watched(centers_m: np.ndarray, present: np.ndarray, hidden: tuple[int, ...] = ()):
    """Return a rig, the detections of people where images show them, and their tracks.

    Args:
        centers_m: shape (person, 3).
        present: shape (frame, person), bool.
        hidden: views in which the last person is never detected.
    """
    rig, rng = ring(4), np.random.default_rng(0)
    body = body_points(rng, 1)[0]
    body = 0.3 * (body - body.mean(axis=0))
    pixels = np.swapaxes(rig.project(np.array(centers_m)[:, None] + body), 0, 1)
    sizes = np.array([camera.size_px for camera in rig.cameras])
    visible = ((pixels > 0) & (pixels < sizes[:, None, None])).all(axis=(2, 3))
    visible[list(hidden), -1] = False
    rows, counts = [], []
    detection = np.full((N_FRAMES, len(centers_m), len(rig)), -1, dtype=np.int32)
    for frame in range(N_FRAMES):
        for view in range(len(rig)):
            shown = np.flatnonzero(visible[view] & present[frame])
            detection[frame, shown, view] = np.arange(len(shown))
            rows += [pixels[view, person] for person in shown]
            counts.append(len(shown))
    detections = Detections(
        skeleton=find_skeleton("coco_17"), view_names=rig.names, frame_numbers=np.arange(N_FRAMES),
        time_s=np.repeat(np.arange(N_FRAMES)[:, None] / 30.0, 4, axis=1),
        offsets=np.concatenate([[0], np.cumsum(counts)]),
        keypoints_px=np.array(rows), confidence=np.ones((len(rows), 17)), recorded=np.ones((N_FRAMES, 4), dtype=bool),
        track_ids=np.full(len(rows), -1), rate_hz=30.0,
    )  # fmt: skip
    state = np.where(present, TrackState.ACTIVE, TrackState.ABSENT).astype(np.int8)
    return rig, detections, Tracks(tuple(f"person_{p}" for p in range(len(centers_m))), detection, state)


@pytest.fixture
def present():
    """A spectator is there all the time, the subject for 45 % of it."""
    out = np.ones((N_FRAMES, 2), dtype=bool)
    out[27:, 1] = False
    return out


def test_spectator_whom_few_cameras_see_is_not_the_subject(present):
    rig, detections, tracks = watched(np.array([[3.0, 3.4, 1.0], [0.0, 0.0, 1.0]]), present)
    counts = (tracks.detection >= 0).sum(axis=(0, 2))
    assert counts[0] > counts[1], "the spectator has more detections"
    volume = time_in_common_volume(rig, detections, tracks)
    assert volume.n_views == 4
    assert volume.share == pytest.approx([0.0, 0.45])
    subject = longest_subject(rig, detections, tracks)
    assert (subject.tracks(0, N_FRAMES).detection[:, 0] == tracks.detection[:, 1]).all()


def test_hidden_people_are_in_the_volume(present):
    rig, detections, tracks = watched(np.array([[3.0, 3.4, 1.0], [0.0, 0.0, 1.0]]), present, hidden=(1,))
    assert time_in_common_volume(rig, detections, tracks).share[1] == pytest.approx(0.45)


def test_cameras_without_a_common_volume_count_as_many_as_see_someone(present):
    rig, detections, tracks = watched(np.array([[3.0, 3.4, 1.0], [3.0, 3.6, 1.0]]), present)
    volume = time_in_common_volume(rig, detections, tracks)
    assert volume.n_views == 2
    assert volume.share == pytest.approx([1.0, 0.45])
