"""The tracker: predict, associate, update and manage, frame by frame. See docs/methods/tracking.md."""

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.kernels.tracking.records import State
from posefuse.model.frames import Frame
from posefuse.model.tracks import TrackState
from posefuse.tracking.associate import Association, associate
from posefuse.tracking.body_frames import BodyFrame, anchors_of, find_exchanged, mirror_images, turns_of
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.bone_lengths import keypoints_at_one_time
from posefuse.tracking.frame_clock import FrameClock
from posefuse.tracking.manage import Bookkeeping, Management, manage
from posefuse.tracking.parts import add_parts, part_trackers
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
        self.images = mirror_images(settings.skeleton)
        """Index of the part that mirrors each part, or None."""
        self.parts = part_trackers(settings, self.images)
        """Trackers of hands and faces, which do not change the bodies; empty while they are used elsewhere."""

    def update(self, frame: Frame) -> People:
        """Process a frame and return all people in it; see :meth:`process`."""
        return self.process(frame).people

    def process(self, frame: Frame) -> TrackedFrame:
        """Process a frame and return everything that the tracker found in it; arguments as of :meth:`track_bodies`."""
        tracked = self.track_bodies(frame)
        if tracked.bodies is not None:
            for part in self.parts:
                part.update(frame, tracked.bodies)
            add_parts(self.parts, tracked.people)
        return tracked

    def track_bodies(self, frame: Frame) -> TrackedFrame:
        """Process a frame without hands and faces.

        Each of ``parts`` can track its part from the bodies of all frames, passed to it in order.

        Args:
            frame: A frame later than the last one.

        Raises:
            DetectionsError: If the frame does not fit the cameras or the skeleton, or is not later than the last one.
        """
        self._check(frame)
        dt_s = self.clock.advance(frame)
        now = FrameInput(frame, self.clock.time_s, dt_s, self.clock.view_dt_s)
        tracks, monitor, setup, s = self.confirmed, self.book.monitor, self.setup, self.settings
        prediction = predict(tracks, now, setup)
        association = associate(tracks, now, prediction, monitor.rejected, setup)
        updated = update(tracks, now, prediction, association, setup)
        assigned = _assigned_keypoints(tracks, now, association, s)
        managed = manage(tracks, self.book, now, prediction, association, updated, setup)
        has_parts = bool(s.skeleton.parts)
        projected = self.confirmed.projected(s.cameras if has_parts else s.cameras[:0], s)
        bodies = self._bodies(now, managed, projected) if has_parts else None
        people = self._people(now, managed, projected)
        return TrackedFrame(people, managed.past_states, managed.swaps, assigned, bodies)

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

    def _people(self, now: FrameInput, managed: Management, projected: ProjectedBodies) -> People:
        """Return the people of the frame: active, then lost, then tentative."""
        used = managed.used
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

    def _bodies(self, now: FrameInput, managed: Management, projected: ProjectedBodies) -> BodyFrame:
        """Return the bodies to which hands and faces are anchored."""
        s = self.settings
        swapped = {number for swap in managed.swaps for number in swap.numbers}
        return BodyFrame(
            now.frame.number, now.time_s, now.dt_s, tuple(each.name for each in self.tracks),
            tuple(each.number for each in self.tracks),
            # People whose identities were swapped; their parts start again with the lengths of their names.
            frozenset(each.name for each in self.tracks if each.number in swapped), managed.rows,
            find_exchanged(now.frame, managed.rows, projected, s.skeleton, self.images, s.options.parts.swap_margin_m),
            *anchors_of(projected, s.skeleton), *turns_of(self.state),
        )  # fmt: skip


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
