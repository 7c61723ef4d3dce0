"""Results of several people that enter and leave, built from simulated scenes without a tracker."""

from dataclasses import replace

import numpy as np

from posefuse.model.label_swaps import Swaps
from posefuse.model.noise import NoiseModel
from posefuse.model.reconstruction import Layer, Provenance, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.track_events import Event, Poses
from posefuse.model.tracks import Tracks, TrackState
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.crowd_options import CrowdFaults, CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd

TENTATIVE_FRAMES = 3


def simulate_walkers(people: int = 4, seconds: float = 2.0, seed: int = 0) -> CrowdScene:
    """Return walking people, and a detector with many false detections."""
    options = CrowdOptions(people=people, duration_s=seconds, seed=seed, skeleton="body_20")
    return simulate_crowd(replace(options, faults=CrowdFaults(false_share=0.2)))


def track_perfectly(scene: CrowdScene, seed: int = 0) -> Reconstruction:
    """What an excellent tracker would make of a crowd: 1 cm off, each detection its owner's.

    The last person is away for the middle third of the time.
    """
    rng = np.random.default_rng(seed)
    truth = np.array(scene.truth.layers["measured"].points_m)
    frames, people = truth.shape[:2]
    truth[frames // 3 : 2 * frames // 3, -1] = np.nan
    present = np.isfinite(truth).any(axis=(2, 3))
    tracks = _tracks(scene, present)
    noise = 0.01 * rng.standard_normal((2, *truth.shape))
    skeleton = shipped_skeleton("body_20")
    return Reconstruction(
        rig=scene.rig,
        skeleton=skeleton,
        person_ids=tracks.person_ids,
        frame_numbers=scene.detections.frame_numbers,
        time_s=np.nanmean(scene.detections.time_s, axis=1),
        layers={
            "measured": _layer(scene, tracks, truth + noise[0], Source.MEASURED),
            "model": _layer(scene, tracks, truth + noise[1], Source.MODELED),
        },
        tracks=tracks,
        noise=NoiseModel(np.full(len(scene.rig), 4.5), 1.0),
        swaps=Swaps(("arm", "leg"), rng.integers(-1, 2, (frames, people, len(scene.rig), 2)).astype(np.int8)),
        poses=_poses(rng, present),
        events=_events(tracks, scene),
        rate_hz=scene.detections.rate_hz,
        provenance=Provenance({"posefuse": "1"}, {"keypoints.nc": "0" * 64}, ("a note",)),
    )


def _tracks(scene: CrowdScene, present: np.ndarray) -> Tracks:
    detections = scene.detections
    frames, people = present.shape
    detection = np.full((frames, people, detections.n_views), -1, dtype=np.int32)
    for row in range(len(scene.owner) - 1, -1, -1):
        frame, view = divmod(int(np.searchsorted(detections.offsets, row, side="right")) - 1, detections.n_views)
        owner = scene.owner[row]
        if owner >= 0 and present[frame, owner]:
            detection[frame, owner, view] = row - detections.offsets[frame * detections.n_views + view]
    state = np.where(present, TrackState.ACTIVE, TrackState.ABSENT).astype(np.int8)
    for p in range(people):
        began = np.flatnonzero(np.diff(present[:, p].astype(int), prepend=0) > 0)
        for f in began:
            state[f : f + TENTATIVE_FRAMES, p] = TrackState.TENTATIVE
        ended = np.flatnonzero(~present[1:, p] & present[:-1, p])
        for f in ended:
            state[f + 1 : f + 4, p] = TrackState.LOST
    return Tracks(tuple(f"person_{p + 1}" for p in range(people)), detection, state)


def _layer(scene: CrowdScene, tracks: Tracks, points: np.ndarray, source: Source) -> Layer:
    rows = tracks.rows(scene.detections)
    pixels = np.moveaxis(scene.rig.project(points), 1, 2)
    visible = np.where((rows >= 0)[..., None, None], np.asarray(scene.detections.keypoints_px)[rows], np.nan)
    error = np.linalg.norm(pixels - visible, axis=-1).transpose(0, 1, 3, 2)
    present = np.isfinite(points[..., 0])
    used = np.isfinite(error)
    status = np.where(present, PointStatus.OK, PointStatus.NOT_SEEN).astype(np.int8)
    view_status = np.where(used, ViewStatus.USED, ViewStatus.UNSEEN).astype(np.int8)
    covariance = np.where(present[..., None], np.array([1e-4, 0, 0, 1e-4, 0, 1e-4]), np.nan)
    mean = np.where(used, error, 0).sum(axis=-1) / np.maximum(used.sum(axis=-1), 1)
    return Layer(
        points, covariance, status, np.where(present, source, Source.NONE).astype(np.int8),
        np.where(used.any(axis=-1), mean, np.nan), view_status, error.astype(np.float32),
    )  # fmt: skip


def _poses(rng: np.random.Generator, present: np.ndarray) -> Poses:
    frames, people = present.shape
    turns = np.linalg.qr(rng.standard_normal((frames, people, 3, 3, 3)))[0]
    ways = rng.standard_normal((frames, people, 2, 3))
    ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
    return Poses(
        ("pelvis", "thorax", "head"), ("left_knee", "right_knee"), ("thigh", "shank"), ("elbow_bend", "knee_bend"),
        np.where(present[..., None, None, None], turns, np.nan), np.where(present[..., None, None], ways, np.nan),
        np.where(present[..., None], rng.uniform(1.0, 9.0, (frames, people, 2)), np.nan),
        np.where(present[..., None], 0.01 * np.array([1.0, 0.0, 0.0, 2.0, 0.0, 3.0]), np.nan),
        np.where(present, rng.uniform(80.0, 120.0, (frames, people)), np.nan),
        np.where(present, 100, 0).astype(np.int32),
        rng.uniform(0.3, 0.5, (people, 2)), rng.uniform(0.01, 0.02, (people, 2)),
    )  # fmt: skip


def _events(tracks: Tracks, scene: CrowdScene) -> tuple[Event, ...]:
    numbers, time_s = scene.detections.frame_numbers, np.nanmean(scene.detections.time_s, axis=1)
    state = np.asarray(tracks.state)
    events = []
    for f, p in zip(*np.nonzero(np.diff(state, axis=0, prepend=state[:1])), strict=True):
        name, when = tracks.person_ids[p], (int(numbers[f]), float(time_s[f]))
        if state[f, p] == TrackState.ACTIVE:
            reference = (state[:f, p] == TrackState.LOST).any()
            events.append(Event(*when, name, "reidentified" if reference else "confirmed", "seen by 4 cameras"))
        elif state[f, p] == TrackState.LOST:
            events.append(Event(*when, name, "lost", "not seen for 0.3 s, though 3 cameras should see them"))
        elif state[f, p] == TrackState.ABSENT:
            events.append(Event(*when, name, "terminated", "lost for 0.1 s"))
    return tuple(events)


def without_people(scene: CrowdScene) -> Reconstruction:
    """Return the result of the same recording without people."""
    whole = track_perfectly(scene)
    empty = {
        name: Layer(*(np.asarray(value)[:, :0] for value in vars(layer).values()))
        for name, layer in whole.layers.items()
    }
    tracks = Tracks((), np.asarray(whole.tracks.detection)[:, :0], np.asarray(whole.tracks.state)[:, :0])
    return replace(whole, person_ids=(), layers=empty, tracks=tracks, swaps=None, poses=None, events=())
