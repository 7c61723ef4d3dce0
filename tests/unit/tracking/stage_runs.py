"""Runs of the tracker with single stages enabled or disabled."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.synthetic.crowd_options import NO_FAULTS, CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, crowd_of_points, simulate_crowd
from posefuse.synthetic.options import CLEAN
from posefuse.tracking.records import People, Person
from posefuse.tracking.tracker import ArticulatedTracker


def tracker_without(scene: CrowdScene, *stages: str) -> ArticulatedTracker:
    """Return a tracker for a scene with some stages disabled."""
    options = TrackerOptions()
    for stage in stages:
        options = replace(options, **{stage: replace(getattr(options, stage), enabled=False)})
    whole = Options(tracker=options)
    return tracker_of(scene.rig, scene.detections.skeleton, default_noise(scene.rig, whole), whole)


def run_without(scene: CrowdScene, *stages: str, detections: Detections | None = None) -> list[People]:
    """Return the people of every frame, tracked with some stages disabled."""
    tracker, source = tracker_without(scene, *stages), detections or scene.detections
    return [tracker.update(Frame.of(source, i)) for i in range(source.n_frames)]


def select_rows(detections: Detections, selected: np.ndarray) -> Detections:
    """Return the selected detections, with ``selected`` of shape (row,), bool."""
    offsets = np.concatenate([[0], np.cumsum(selected)])[np.asarray(detections.offsets)]
    return replace(
        detections, offsets=offsets, keypoints_px=np.asarray(detections.keypoints_px)[selected],
        confidence=np.asarray(detections.confidence)[selected], track_ids=np.asarray(detections.track_ids)[selected],
    )  # fmt: skip


def events_of(results: Iterable[People], *kinds: str) -> list[Event]:
    """Return the events of all frames, or only those of some kinds."""
    return [event for people in results for event in people.events if not kinds or event.what in kinds]


def active_people(people: People) -> dict[str, Person]:
    """Return the active people of a frame by name."""
    return {person.name: person for person in people.people if person.state == TrackState.ACTIVE}


def errors_m(results: Sequence[People], name: str, truth_m: np.ndarray) -> np.ndarray:
    """Return the mean keypoint errors of a person, shape (frame,), NaN while the person is not active.

    Args:
        results: Tracked people of every frame.
        name: Name of the person.
        truth_m: shape (frame, keypoint, 3): true points.
    """
    errors = np.full(len(results), np.nan)
    for i, people in enumerate(results):
        person = active_people(people).get(name)
        if person is not None:
            errors[i] = np.nanmean(np.linalg.norm(person.points_m - truth_m[i], axis=-1))
    return errors


def assert_equal_results(results: Sequence[People], others: Sequence[People]) -> None:
    """Assert that the people and the events of all frames are bitwise equal."""
    for one, other in zip(results, others, strict=True):
        assert one.events == other.events
        assert_equal_people(one, other)


def assert_equal_people(one: People, other: People) -> None:
    """Assert that the people of a frame are bitwise equal."""
    assert [(p.name, p.state, p.log_odds) for p in one.people] == [(p.name, p.state, p.log_odds) for p in other.people]
    for first, second in zip(one.people, other.people, strict=True):
        np.testing.assert_array_equal(first.points_m, second.points_m)
        np.testing.assert_array_equal(first.covariance_m2, second.covariance_m2)
        np.testing.assert_array_equal(first.rows, second.rows)
        np.testing.assert_array_equal(first.used, second.used)


def clean_scene(people: int, duration_s: float, seed: int = 3, rate_hz: float = 25.0) -> CrowdScene:
    """Return walking people whose detections have Gaussian errors and no faults."""
    return simulate_crowd(
        CrowdOptions(
            people=people, duration_s=duration_s, rate_hz=rate_hz, seed=seed, detector=CLEAN, faults=NO_FAULTS
        )
    )  # fmt: skip


def scene_of_points(points_m: np.ndarray, scene: CrowdScene) -> CrowdScene:
    """Return clean detections of other motion, shape (frame, person, keypoint, 3), in the cameras of a scene."""
    skeleton, rate_hz = scene.detections.skeleton, scene.detections.rate_hz
    assert rate_hz is not None
    return crowd_of_points(points_m, scene.rig, skeleton, rate_hz, detector=CLEAN, faults=NO_FAULTS)


def true_points_m(scene: CrowdScene) -> np.ndarray:
    """Return the true points, shape (frame, person, keypoint, 3)."""
    return np.array(scene.truth.layers["measured"].points_m)


def frames_and_views(detections: Detections) -> tuple[np.ndarray, np.ndarray]:
    """Return frame and view of each detection, shape (row,) each."""
    cells = detections.n_frames * detections.n_views
    return np.divmod(np.repeat(np.arange(cells), np.diff(detections.offsets)), detections.n_views)
