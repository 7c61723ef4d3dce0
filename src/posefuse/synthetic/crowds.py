"""Simulated scenes with several people: motion, camera faults and detections."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from posefuse.arguments import checked
from posefuse.errors import OptionsError, SkeletonError
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.detections import Detections
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.skeletons import Skeleton, find_skeleton
from posefuse.synthetic.bodies import Capsules
from posefuse.synthetic.crowd_detector import detect_crowd
from posefuse.synthetic.crowd_options import CrowdFaults, CrowdOptions, Scenario
from posefuse.synthetic.crowd_records import CrowdDetections, Kind, Staging
from posefuse.synthetic.figures import human
from posefuse.synthetic.options import DetectorOptions
from posefuse.synthetic.rigs import build_rig
from posefuse.synthetic.scenes import truth_of
from posefuse.synthetic.walkers import GRID_HZ, Attendance, Walk, meet, stroll

__all__ = ["CrowdScene", "Kind", "Span", "crowd_of_points", "simulate_crowd"]

_MAX_MERGED_S = 1.5
_TURN_DEG = 20.0


@dataclass(frozen=True)
class Span:
    """An interval of a scripted event.

    Attributes:
        what: ``present``, ``hug``, ``merged``, ``hidden``, ``dark`` or ``bumped``.
        from_s: start time in seconds.
        to_s: end time in seconds; infinity without an end.
        person: affected person, or None.
        view: affected view, for ``hidden`` the only one that sees the person; or None.
    """

    what: str
    from_s: float
    to_s: float
    person: int | None = None
    view: int | None = None


@dataclass(frozen=True)
class CrowdScene:
    """A simulated recording of several people.

    Attributes:
        rig: calibrated cameras.
        detections: simulated detections.
        truth: true keypoint positions; NaN and NOT_SEEN while a person is absent.
        owner: shape (row,), int64: person of each detection, -1 for a false one; of a merged one, the person with more
            keypoints.
        other: shape (row,), int64: second person of a merged detection, otherwise -1.
        kind: shape (row,), int64: :class:`Kind` of each detection.
        true_rig: cameras with their true poses at the end; differs from ``rig`` if one was bumped.
        spans: scripted events.
    """

    rig: CameraRig
    detections: Detections
    truth: Reconstruction
    owner: np.ndarray
    other: np.ndarray
    kind: np.ndarray
    true_rig: CameraRig
    spans: tuple[Span, ...] = ()

    @classmethod
    def of(
        cls,
        rig: CameraRig,
        detected: CrowdDetections,
        truth: Reconstruction,
        staging: Staging,
        spans: tuple[Span, ...],
    ) -> "CrowdScene":
        """Combine detections, truth and scripted events."""
        return cls(
            rig, detected.detections, truth, detected.owner, detected.other, detected.kind, staging.turned_rig, spans
        )


@dataclass(frozen=True)
class _Script:
    """The script of a scenario: walks and staged events."""

    walks: list[Walk]
    staging: Staging
    spans: list[Span] = field(default_factory=list)


@checked
def simulate_crowd(options: CrowdOptions | None = None) -> CrowdScene:
    """Simulate a recording of several people.

    Raises:
        OptionsError: if the options are invalid.
        SkeletonError: if the skeleton does not exist, or is not human.
    """
    options = options or CrowdOptions()
    motion_seed, detector_seed = np.random.SeedSequence(options.seed).spawn(2)
    rng = np.random.default_rng(motion_seed)
    skeleton = find_skeleton(options.skeleton)
    statures = _statures(options, rng)
    rig = _rig(options)
    time_s = np.arange(options.n_frames) / options.rate_hz
    script = _SCENARIOS[options.scenario](options, rig, time_s, rng)
    points = np.stack([_keypoints(w, s, skeleton, time_s) for w, s in zip(script.walks, statures, strict=True)], axis=1)
    present = [Span("present", *span, person=p) for p, walk in enumerate(script.walks) for span in walk.spans_s]
    detected = detect_crowd(
        rig, points, skeleton, options.rate_hz, options.detector, options.faults, script.staging,
        np.random.default_rng(detector_seed),
    )  # fmt: skip
    truth = truth_of(rig, skeleton, points, options.rate_hz)
    return CrowdScene.of(rig, detected, truth, script.staging, (*present, *script.spans))


@checked
def crowd_of_points(
    points_m: np.ndarray,
    rig: CameraRig,
    skeleton: Skeleton,
    rate_hz: float,
    *,
    detector: DetectorOptions | None = None,
    faults: CrowdFaults | None = None,
    seed: int = 0,
) -> CrowdScene:
    """Simulate the detections of known motion, such as motion capture.

    Args:
        points_m: shape (frame, person, keypoint, 3), in the rig's world; NaN if absent.
        rig: cameras.
        skeleton: skeleton of the keypoints.
        rate_hz: frame rate.
        detector: keypoint errors.
        faults: detector errors specific to several people.
        seed: random seed.

    Raises:
        OptionsError: if the points do not match the skeleton.
    """
    points = np.asarray(points_m, dtype=np.float64)
    if points.ndim != 4 or points.shape[2:] != (len(skeleton), 3):
        raise OptionsError(
            f"points_m: expected (frame, person, {len(skeleton)} keypoints of {skeleton.name!r}, 3), "
            f"got shape {points.shape}."
        )
    staging = Staging.plain(rig, len(points))
    rng = np.random.default_rng(seed)
    detector, faults = detector or DetectorOptions(), faults or CrowdFaults()
    detected = detect_crowd(rig, points, skeleton, rate_hz, detector, faults, staging, rng)
    return CrowdScene.of(rig, detected, truth_of(rig, skeleton, points, rate_hz), staging, ())


def _statures(options: CrowdOptions, rng: np.random.Generator) -> tuple[float, ...]:
    drawn = rng.uniform(1.55, 1.9, options.n_people)
    if options.statures_m:
        return options.statures_m
    if options.equal_statures:
        return (float(drawn[0]),) * options.n_people
    if options.scenario == "hug":
        return (float(drawn[0]), float(drawn[0]) * (1.08 if drawn[0] < 1.725 else 1 / 1.08))
    return tuple(float(stature) for stature in drawn)


def _half_room_m(options: CrowdOptions) -> float:
    """Return half the room size: 2 m, more for more than four people."""
    return max(2.0, float(np.sqrt(options.n_people)))


def _rig(options: CrowdOptions) -> CameraRig:
    radius = _half_room_m(options) + 3.0
    return build_rig("ring", options.n_cameras, options.lens, radius_m=radius)


def _keypoints(walk: Walk, stature_m: float, skeleton: Skeleton, time_s: np.ndarray) -> np.ndarray:
    """Return the true keypoints of a walker, shape (frame, keypoint, 3)."""
    figure = human(stature_m)
    if not figure.has(skeleton):
        lacking = ", ".join(sorted(set(skeleton.keypoints) - set(figure.names))[:5])
        raise SkeletonError(
            f"Skeleton {skeleton.name!r} is not human: the human figure has no {lacking}. Choose another skeleton."
        )
    return walk.positions(figure, time_s)[:, figure.columns(skeleton)]


def _strolling(
    options: CrowdOptions, time_s: np.ndarray, rng: np.random.Generator, attendances: tuple[Attendance, ...]
) -> list[Walk]:
    return stroll(attendances, _half_room_m(options), options.length_s, rng)


def _crowd(options: CrowdOptions, rig: CameraRig, time_s: np.ndarray, rng: np.random.Generator) -> _Script:
    """Half of the people are always present; the others enter in the first quarter and leave in the last."""
    n, end = options.n_people, options.length_s
    comes, goes = rng.uniform(0.03, 0.25, n) * end, rng.uniform(0.75, 0.9, n) * end
    attendances = tuple(
        Attendance() if p < (n + 1) // 2 else Attendance(float(comes[p]), float(goes[p])) for p in range(n)
    )
    return _Script(_strolling(options, time_s, rng, attendances), Staging.plain(rig, len(time_s)))


def _leave(options: CrowdOptions, rig: CameraRig, time_s: np.ndarray, rng: np.random.Generator) -> _Script:
    """The last person leaves and returns after 5 s."""
    goes = Attendance(leave_s=float(rng.uniform(7.0, 9.0)), away_s=5.0)
    attendances = (*[Attendance()] * (options.n_people - 1), goes)
    return _Script(_strolling(options, time_s, rng, attendances), Staging.plain(rig, len(time_s)))


def _stay(options: CrowdOptions, time_s: np.ndarray, rng: np.random.Generator) -> list[Walk]:
    return _strolling(options, time_s, rng, (Attendance(),) * options.n_people)


def _hug(options: CrowdOptions, rig: CameraRig, time_s: np.ndarray, rng: np.random.Generator) -> _Script:
    """Two people walk, meet at 9 s, hug, step back, walk around each other, and exchange sides."""
    meets, lasts = 9.0, float(rng.uniform(1.0, 2.0))
    parts = meets + lasts
    to_the = float(rng.uniform(-np.pi, np.pi))
    turn = np.pi * float(rng.choice([-1.0, 1.0]))
    away = rng.uniform(-0.3, 0.3, 4)
    distance = (
        np.array([0.0, 3.0, 5.5, meets, parts, parts + 1.0, parts + 3.0, parts + 5.5]),
        np.array([3.0 + away[0], 2.0 + away[1], 3.2 + away[2], 0.34, 0.34, 0.8, 0.85, 3.2 + away[3]]),
    )
    bearing = (
        np.array([0.0, 5.5, parts + 0.7, parts + 3.2]),
        to_the + np.array([-0.8, 0.0, 0.0, turn]),
    )
    walks = meet(distance, bearing, (meets, parts), (meets - 1.0, parts + 2.5), options.length_s)
    merged_s = float(rng.uniform(0.8, min(lasts, _MAX_MERGED_S)))
    begins = meets + 0.5 * (lasts - merged_s)
    merged = (time_s >= begins) & (time_s < begins + merged_s)
    staging = replace(Staging.plain(rig, len(time_s)), merged=merged, spared_view=int(rng.integers(len(rig))))
    return _Script(walks, staging, [Span("hug", meets, parts), Span("merged", begins, begins + merged_s)])


def _one_camera(options: CrowdOptions, rig: CameraRig, time_s: np.ndarray, rng: np.random.Generator) -> _Script:
    """Pillars in front of all cameras but one hide the first person for 2 s."""
    walks = _stay(options, time_s, rng)
    begins = float(rng.uniform(0.4, 0.6) * options.length_s)
    sees = int(rng.integers(len(rig)))
    when = (time_s >= begins) & (time_s < begins + 2.0)
    grid = np.arange(len(walks[0].floor_m)) / GRID_HZ
    floor = np.stack([np.interp(time_s, grid, axis) for axis in walks[0].floor_m.T], axis=1)
    others = [camera for v, camera in enumerate(rig.cameras) if v != sees]
    staging = replace(Staging.plain(rig, len(time_s)), things=_occluding_pillars(others, floor, when))
    return _Script(walks, staging, [Span("hidden", begins, begins + 2.0, person=0, view=sees)])


def _occluding_pillars(cameras: list[Camera], floor_m: np.ndarray, when: np.ndarray) -> Capsules:
    """Return upright pillars between cameras and a person, just wide enough to hide the person."""
    part, reach = 0.3, 0.55
    feet = [camera.center_m[:2] + part * (floor_m - camera.center_m[:2]) for camera in cameras]
    base = np.where(when[:, None, None], np.stack(feet, axis=1), np.nan)
    low, high = (np.concatenate([base, np.full((*base.shape[:2], 1), z)], axis=2) for z in (-0.5, 3.5))
    return Capsules(low, high, np.full(len(cameras), part * reach), np.full(len(cameras), -1))


def _dark(options: CrowdOptions, rig: CameraRig, time_s: np.ndarray, rng: np.random.Generator) -> _Script:
    """One camera delivers nothing for 10 s."""
    view, begins = int(rng.integers(len(rig))), float(rng.uniform(0.25, 0.4) * options.length_s)
    staging = Staging.plain(rig, len(time_s))
    dark = _with_interval(staging.dark, view, time_s, begins, begins + 10.0)
    return _Script(
        _stay(options, time_s, rng), replace(staging, dark=dark), [Span("dark", begins, begins + 10.0, view=view)]
    )


def _bumped(options: CrowdOptions, rig: CameraRig, time_s: np.ndarray, rng: np.random.Generator) -> _Script:
    """One camera delivers nothing for 2 s and is rotated when it returns."""
    view, begins = int(rng.integers(len(rig))), float(rng.uniform(0.3, 0.4) * options.length_s)
    back = begins + 2.0
    staging = Staging.plain(rig, len(time_s))
    turned = _turned(rig, view, _TURN_DEG * float(rng.choice([-1.0, 1.0])))
    staging = replace(
        staging,
        dark=_with_interval(staging.dark, view, time_s, begins, back),
        turned=_with_interval(staging.turned, view, time_s, back, np.inf),
        turned_rig=turned,
    )
    spans = [Span("dark", begins, back, view=view), Span("bumped", back, np.inf, view=view)]
    return _Script(_stay(options, time_s, rng), staging, spans)


def _turned(rig: CameraRig, view: int, angle_deg: float) -> CameraRig:
    """Return the rig with one camera rotated about the vertical through its center."""
    camera = rig.cameras[view]
    pose = camera.camera_from_world.copy()
    pose[:3, :3] = pose[:3, :3] @ Rotation.from_euler("z", angle_deg, degrees=True).as_matrix()
    pose[:3, 3] = -pose[:3, :3] @ camera.center_m
    cameras = (*rig.cameras[:view], replace(camera, camera_from_world=pose), *rig.cameras[view + 1 :])
    return replace(rig, cameras=cameras)


def _with_interval(mask: np.ndarray, view: int, time_s: np.ndarray, from_s: float, to_s: float) -> np.ndarray:
    result = mask.copy()
    result[:, view] = (time_s >= from_s) & (time_s < to_s)
    return result


_SCENARIOS: dict[Scenario, Callable[[CrowdOptions, CameraRig, np.ndarray, np.random.Generator], _Script]] = {
    "crowd": _crowd,
    "ten": _crowd,
    "hug": _hug,
    "leave": _leave,
    "one_camera": _one_camera,
    "dark": _dark,
    "bumped": _bumped,
}
