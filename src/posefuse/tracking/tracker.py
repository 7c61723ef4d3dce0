"""The tracker: predict, associate, update and manage, frame by frame. See docs/methods/tracking.md."""

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.kernels.tracking.records import State
from posefuse.model.frames import Frame
from posefuse.model.tracks import TrackState
from posefuse.tracking.associate import Association, associate
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.bone_lengths import keypoints_at_one_time
from posefuse.tracking.frame_clock import FrameClock
from posefuse.tracking.manage import Bookkeeping, Management, manage
from posefuse.tracking.parts import BodyFrame, PartTracker, mirrored_parts, swap_mirrored_parts
from posefuse.tracking.predict import FrameInput, predict
from posefuse.tracking.records import AssignedKeypoints, People, Person, Track, TrackedFrame
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.strategies import find_strategy
from posefuse.tracking.strategy import Propose, Strategy, TrackerSetup
from posefuse.tracking.track_set import TrackSet
from posefuse.tracking.update import update


class ArticulatedTracker:
    """Causal tracker of several articulated bodies; all of its state is in its attributes.

    Args:
        settings: Cameras, skeleton, noise model and options.
        propose: Function that proposes people from unassigned detections.
        strategy: Exchangeable components; by default those of the strategy that the options name.
        propose_new: Function that proposes people who are not tracked yet; by default ``propose``.
        propose_lost: Function that proposes people whose tracks were lost; by default ``propose_new``.

    Raises:
        OptionsError: If an option of the strategy does not fit the skeleton.
    """

    def __init__(
        self,
        settings: TrackerSettings,
        propose: Propose,
        strategy: Strategy | None = None,
        propose_new: Propose | None = None,
        propose_lost: Propose | None = None,
    ) -> None:
        strategy = strategy or find_strategy(settings.options.strategy)
        settings = strategy.configure(settings)
        propose_new = propose_new or propose
        self.setup = TrackerSetup(settings, strategy, propose, propose_new, propose_lost or propose_new)
        self.confirmed = TrackSet.empty(settings)
        """Confirmed tracks with their states."""
        self.book = Bookkeeping.new(len(settings.rig))
        """Tentative tracks, camera statistics and contacts."""
        self.clock = FrameClock()
        self.parts = tuple(PartTracker(part, settings) for part in settings.skeleton.parts)
        """Trackers of hands and faces; they do not change the bodies."""
        self.mirrored = mirrored_parts(self.parts, settings.skeleton.mirror)
        """Pairs of parts that mirror each other."""

    def update(self, frame: Frame) -> People:
        """Process a frame and return all people in it; see :meth:`process`."""
        return self.process(frame).people

    def process(self, frame: Frame) -> TrackedFrame:
        """Process a frame and return everything that the tracker found in it.

        Args:
            frame: A frame later than the last one.

        Raises:
            DetectionsError: If the frame does not fit the cameras or the skeleton, or is not later than the last one.
        """
        self._check(frame)
        dt_s = self.clock.advance(frame)
        now = FrameInput(frame, self.clock.time_s, dt_s, self.clock.view_dt_s)
        tracks, monitor, setup = self.confirmed, self.book.monitor, self.setup
        prediction = predict(tracks, now, setup)
        association = associate(tracks, now, prediction, monitor.rejected, setup)
        updated = update(tracks, now, prediction, association, setup)
        assigned = _assigned_keypoints(tracks, now, association, setup.settings)
        managed = manage(tracks, self.book, now, prediction, association, updated, setup)
        people = self._people(now, managed)
        return TrackedFrame(people, managed.past_states, managed.swaps, assigned)

    @property
    def settings(self) -> TrackerSettings:
        """Cameras, skeleton, noise model and options."""
        return self.setup.settings

    @property
    def tracks(self) -> list[Track]:
        """Confirmed tracks, in the order of ``state``."""
        return self.confirmed.tracks

    @property
    def state(self) -> State:
        """States of the confirmed tracks."""
        return self.confirmed.state

    @property
    def time_s(self) -> float:
        """Time of the last frame, in seconds; NaN before the first."""
        return self.clock.time_s

    def shape_of(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Return bone lengths of a track and their standard deviations, shape (shape,) each, in meters."""
        tree, track, state = self.settings.tree, self.tracks[index], self.state
        n, h = tree.n_pose, tree.n_shape
        block = track.known_shape[1] if track.known_shape else state.covariance[index, n : n + h, n : n + h]
        return state.shape[index].copy(), np.sqrt(block.diagonal())

    def _check(self, frame: Frame) -> None:
        views, keypoints = len(self.settings.rig), len(self.settings.skeleton)
        if len(frame.recorded) != views or (len(frame.view) and frame.keypoints_px.shape[1] != keypoints):
            raise DetectionsError(
                f"Frame {frame.number} has {len(frame.recorded)} views and {frame.keypoints_px.shape[1]} keypoints per "
                f"person; this tracker has {views} cameras and {keypoints} keypoints."
            )

    def _people(self, now: FrameInput, managed: Management) -> People:
        """Return the people of the frame: active, then lost, then tentative."""
        s, used = self.settings, managed.used
        projected = self.confirmed.projected(s.cameras if self.parts else s.cameras[:0], s)
        if self.parts:
            self._update_parts(now, managed, projected)
        people = [
            Person(
                track.name, track.state, projected.points_m[p], projected.covariance_m2[p], managed.rows[p], used[p],
                track.log_odds, now.time_s - track.last_seen_s, *managed.innovations.get(track.number, (np.nan, 0)),
            )
            for p, track in enumerate(self.tracks)
        ]  # fmt: skip
        people.sort(key=lambda person: person.state != TrackState.ACTIVE)
        for each in self.book.pool.tracks:
            last = each.observations[-1]
            if last.time_s == now.time_s:
                people.append(
                    Person(
                        f"tentative_{each.number}", TrackState.TENTATIVE, last.points_m, last.covariance_m2, last.rows,
                        np.isfinite(last.keypoints_px[..., 0]), each.score, 0.0,
                    )
                )  # fmt: skip
        return People(now.frame.number, now.time_s, tuple(people), managed.events)

    def _update_parts(self, now: FrameInput, managed: Management, projected: ProjectedBodies) -> None:
        """Track hands and faces, and write their points and used keypoints into those of the bodies."""
        names, skeleton = tuple(track.name for track in self.tracks), self.settings.skeleton
        labels = np.tile(np.arange(len(skeleton)), (*managed.rows.shape, 1))
        margin_m = self.settings.options.parts.swap_margin_m
        for pair in self.mirrored:
            swap_mirrored_parts(labels, now.frame, managed.rows, projected, pair, margin_m)
        bodies = BodyFrame.of(names, managed.rows, labels, projected, self.state)
        for part in self.parts:
            for swap in managed.swaps:
                part.reset({track.name for track in self.tracks if track.number in swap.numbers})
            part.update(now.frame, now.time_s, now.dt_s, bodies)
        for part in self.parts:
            k = part.part.keypoints
            for person in part.people:
                p = names.index(person.name)
                projected.points_m[p, k], projected.covariance_m2[p, k] = person.points_m, person.covariance_m2
                managed.used[p][:, k] = person.used


def _assigned_keypoints(
    tracks: TrackSet, now: FrameInput, association: Association, settings: TrackerSettings
) -> AssignedKeypoints:
    """Return the keypoints assigned to the updated tracks, as they were at the time of the frame."""
    frame, rows = association.frame, association.shared
    pixels = frame.keypoints_px
    if len(tracks) and len(frame.view):
        pixels = keypoints_at_one_time(tracks.state, frame, now.time_s, rows, settings)
    numbers = tuple(track.number for track in tracks.tracks)
    return AssignedKeypoints(numbers, pixels, frame.confidence, rows, association.labels)
