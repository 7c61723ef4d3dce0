"""Recordings with known cameras, on which calibrations from people are scored."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import posefuse
from benchmarks import panoptic
from benchmarks.mvor import read_mvor
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.detections import Detections
from posefuse.model.view_names import matching_name
from posefuse.synthetic.crowds import Kind, crowd_of_points


@dataclass(frozen=True, eq=False)
class CalibrationCase:
    """A recording and its true calibration.

    Attributes:
        name: name of the recording.
        detections: what the cameras detected; views have the names of the cameras, people no identities.
        rig: true cameras.
        offset_s: shape (view,): true time minus timestamp.
        rate_hz: shape (view,): frame rate.
        unrelated: names of cameras that see nothing of what the others see.
        person: shape (row,): true person of each detection, -1 for none; None if unknown.
    """

    name: str
    detections: Detections
    rig: CameraRig
    offset_s: np.ndarray
    rate_hz: np.ndarray
    unrelated: tuple[str, ...] = ()
    person: np.ndarray | None = None

    def lenses(self, *, focal_known: bool = True) -> CameraRig:
        """Return the cameras as a user has them: without poses, optionally without focal lengths."""
        return CameraRig(tuple(_lens(camera, focal_known) for camera in self.rig.cameras))


def _lens(camera: Camera, focal_known: bool) -> Camera:
    placed = replace(camera, camera_from_world=np.eye(4))
    return placed if focal_known else without_focal(placed)


def without_focal(camera: Camera) -> Camera:
    """Return a pinhole camera whose focal length is the larger side of its image, a field of view of 53 degrees."""
    width, height = camera.size_px
    focal = float(max(width, height))
    matrix = np.array([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])
    return Camera(camera.name, camera.size_px, matrix, camera.camera_from_world)


def shuffled(case: CalibrationCase, seed: int = 0) -> CalibrationCase:
    """Return a recording with the detections of every view and frame in random order and without identities.

    Identities of the detections are kept as the true persons.
    """
    rng = np.random.default_rng(seed)
    old = case.detections
    counts = old.people_counts.ravel()
    order = [start + rng.permutation(n) for start, n in zip(old.offsets[:-1], counts, strict=True)]
    rows = old.rows(np.concatenate(order).astype(np.int64))
    person = np.asarray(rows["track_ids"])
    detections = replace(old, **{**rows, "track_ids": np.full(len(person), -1)})  # type: ignore[arg-type]
    return replace(case, detections=detections, person=person if (person >= 0).any() else None)


def staggered(case: CalibrationCase, offset_s: np.ndarray) -> CalibrationCase:
    """Return a recording whose views start one after the other, each with timestamps from its own start.

    Args:
        case: the recording, whose timestamps are right.
        offset_s: shape (view,): start of each view, at least 0; rounded to whole frames.
    """
    old = case.detections
    skipped = np.round(np.asarray(offset_s) * case.rate_hz).astype(int)
    n = old.n_frames - int(skipped.max())
    frame = np.arange(n)[:, None] + skipped[None]
    view = np.broadcast_to(np.arange(old.n_views), frame.shape)
    counts = old.people_counts[frame, view]
    starts = old.offsets[:-1].reshape(old.n_frames, old.n_views)[frame, view].ravel()
    offsets = np.concatenate([[0], np.cumsum(counts.ravel())])
    rows = np.repeat(starts - offsets[:-1], counts.ravel()) + np.arange(int(offsets[-1]))
    time_s = old.time_s[frame, view]
    start_s = old.time_s[skipped, np.arange(old.n_views)]
    detections = replace(
        old,
        frame_numbers=np.arange(n),
        time_s=time_s - start_s,
        offsets=offsets,
        recorded=old.recorded[frame, view],
        **old.rows(rows),  # type: ignore[arg-type]
    )
    return replace(
        case,
        name=f"{case.name} staggered",
        detections=detections,
        offset_s=case.offset_s + start_s,
        person=None if case.person is None else case.person[rows],
    )


def _named(detections: Detections, rig: CameraRig) -> Detections:
    """Return the detections with the names of the cameras."""
    names = [matching_name(name, rig.names) for name in detections.view_names]
    if None in names or len(set(names)) != len(names):
        raise ValueError(f"Views {detections.view_names} do not match cameras {rig.names}.")
    return replace(detections, view_names=tuple(str(name) for name in names)).views(rig.names)


def case_of(name: str, rig: CameraRig, detections: Detections, rate_hz: float) -> CalibrationCase:
    """Return the case of a recording whose timestamps are right."""
    n = len(rig)
    return CalibrationCase(name, _named(detections, rig), rig, np.zeros(n), np.full(n, rate_hz))


def _pose2sim(folder: Path, recording: str, people: str) -> tuple[CameraRig, Detections]:
    place = folder / "pose2sim"
    rig = posefuse.read_cameras(place / "calibration" / "Calib.qca.txt")
    return rig, posefuse.read_detections(place / recording / people).with_rate(60.0)


def balancing(folder: Path) -> CalibrationCase:
    """One balancing person for 1.7 s, OpenPose's BODY_25B, four phones' portrait views."""
    return case_of("balancing", *_pose2sim(folder, "balancing_one_person", "pose-associated"), 60.0)


def balancing_raw(folder: Path) -> CalibrationCase:
    """The same with the detections of bystanders in two views."""
    rig, detections = _pose2sim(folder, "balancing_one_person", "pose")
    return shuffled(case_of("balancing_raw", rig, detections, 60.0))


def two_people(folder: Path) -> CalibrationCase:
    """Two people and a bystander, whose identities are not known."""
    rig, detections = _pose2sim(folder, "two_people", "pose")
    return shuffled(case_of("two_people", rig, detections, 60.0))


def webcams(folder: Path) -> CalibrationCase:
    """One person for 9 s, MediaPipe, four webcams with timestamps of their own."""
    place = folder / "caliscope_webcams"
    rig = posefuse.read_cameras(place / "config.toml")
    return case_of("webcams", rig, posefuse.read_detections(place / "xy_HOLISTIC.csv"), 30.4)


def panoptic_one(folder: Path, duration_s: float = 60.0) -> CalibrationCase:
    """Motion capture of one person before five cameras of a dome; the detector is simulated."""
    motion = panoptic.one_person(folder)
    points = motion.points_m[: round(duration_s * motion.rate_hz)]
    scene = crowd_of_points(points, motion.rig, motion.skeleton, motion.rate_hz)
    person = np.where(scene.kind == Kind.PERSON, scene.owner, -1)
    detections = replace(scene.detections, track_ids=person)
    return shuffled(case_of("panoptic", motion.rig, detections, motion.rate_hz))


def mvor(folder: Path) -> CalibrationCase:
    """An operating room, three cameras, OpenPose; frames are 75 s apart."""
    data = read_mvor(folder / "mvor")
    return case_of("mvor", data.rig, data.detections, float("nan"))


def balancing_mediapipe(folder: Path, keypoints: Path) -> CalibrationCase:
    """The video of the balancing person, MediaPipe.

    Two of the videos are 1080 px wide where the calibration has 1088: they were reduced in proportion and padded in
    height, as corresponding points of the videos and the pictures for the calibration show.

    Args:
        folder: folder of the recordings.
        keypoints: folder with ``pose2sim_videos.npz``, which ``benchmarks/peers/mediapipe`` writes.
    """
    rig = posefuse.read_cameras(folder / "pose2sim_videos" / "calibration" / "Calib.qca.txt")
    cameras = tuple(reduced(camera, 1080) if i < 2 else camera for i, camera in enumerate(rig.cameras))
    detections = posefuse.read_detections(keypoints / "pose2sim_videos.npz")
    return case_of("balancing_mediapipe", replace(rig, cameras=cameras), detections, 60.0)


def reduced(camera: Camera, width: int) -> Camera:
    """Return a camera whose image is reduced to a width; its height is kept by more image above and below."""
    factor = width / camera.size_px[0]
    added = camera.size_px[1] * (1.0 - factor) / 2.0
    matrix = camera.matrix.copy()
    matrix[:2] *= factor
    matrix[0, 2] += (factor - 1.0) / 2.0
    matrix[1, 2] += (factor - 1.0) / 2.0 + added
    return replace(camera, matrix=matrix, size_px=(width, camera.size_px[1]))


RECORDINGS: dict[str, Callable[[Path], CalibrationCase]] = {
    "balancing": balancing,
    "balancing_raw": balancing_raw,
    "two_people": two_people,
    "webcams": webcams,
    "panoptic": panoptic_one,
    "mvor": mvor,
}
"""Recordings by name; ``balancing_mediapipe`` needs the keypoints of videos, too."""


def recording(name: str, folder: Path, keypoints: Path | None = None) -> CalibrationCase:
    """Return a recording by name.

    Args:
        name: one of :data:`RECORDINGS`, or ``balancing_mediapipe``.
        folder: folder of the recordings.
        keypoints: folder of keypoints that were detected in videos.
    """
    if name != "balancing_mediapipe":
        return RECORDINGS[name](folder)
    if keypoints is None:
        raise ValueError("balancing_mediapipe needs the folder of keypoints that benchmarks/peers/mediapipe writes.")
    return balancing_mediapipe(folder, keypoints)
