"""Smooth the bodies of one window of a long recording, independently of the other windows.

People are tracked through the whole recording once, and the tracker is stored as it is some seconds before each window.
From there, another process tracks the window again, with the same result, to get the states of the bodies without a
transfer of the whole history. It smooths them with the priors of the whole recording, chunk by chunk as an undivided
run does, so that fitted bodies are the same. Other bodies, hands and faces depend on all earlier frames.
"""

import itertools
from dataclasses import dataclass, fields, replace

import numpy as np

from posefuse.arrays import ranges
from posefuse.checkpoint import Checkpoint
from posefuse.errors import FileError
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Layer
from posefuse.model.track_events import Poses
from posefuse.model.tracks import Tracks
from posefuse.pipeline.people.track_recording import continue_tracking, frame_times, tracker_name
from posefuse.pipeline.people.tracked_people import TrackedPeople, TrackNames
from posefuse.tracking.path_priors import PathPriors, estimate_priors
from posefuse.tracking.tracker import ArticulatedTracker

_BEFORE_S = 30.0
"""Earlier frames change bodies that are not fitted by less than 0.1 mm, and do not matter for the others."""

_CONFIRMED_AFTER_S = 10.0
"""Time after which a track that begins in a window is confirmed, and its earlier frames are known."""


@dataclass(frozen=True)
class Window:
    """A range of frames of a recording, and the wider range that is tracked again.

    Attributes:
        first: index of the first frame of the wider range.
        start: index of the first frame of the window itself.
        stop: index after its last frame.
        last: index after the last frame of the wider range.
    """

    first: int
    start: int
    stop: int
    last: int


WindowBodies = tuple[Layer, Poses]
"""The model layer and the poses of a window, without the frames around it."""


def windows_of(times_s: np.ndarray, rate_hz: float, window_s: float, options: Options) -> list[Window]:
    """Divide a recording into windows of nearly equal length, which begin where a chunk does.

    Args:
        times_s: shape (frame,): times of the frames of the recording.
        rate_hz: typical frame rate.
        window_s: approximate length of a window.
        options: options of the reconstruction, which define the chunks and how far later frames influence bodies.
    """
    n_frames, chunk, tracker = len(times_s), options.chunk_frames, options.tracker
    number = max(round(n_frames / (window_s * rate_hz)), 1)
    after_s = _CONFIRMED_AFTER_S + tracker.look_ahead_s + tracker.fix_shape_after_s
    before_s = max(_BEFORE_S, tracker.look_ahead_s)
    # The smoother works chunk by chunk, and what it finds depends on their borders.
    inner = np.unique(np.linspace(0, n_frames / chunk, number + 1)[1:-1].round().astype(int)) * chunk
    bounds = [0, *(place for place in inner.tolist() if 0 < place < n_frames), n_frames]
    # By times, because the frame rate may vary.
    latest_s = np.maximum.accumulate(times_s)
    firsts = np.searchsorted(latest_s, latest_s[bounds[:-1]] - before_s).tolist()
    lasts = np.searchsorted(latest_s, latest_s[np.array(bounds[1:]) - 1] + after_s, side="right").tolist()
    return [
        Window(first, start, stop, last)
        for first, (start, stop), last in zip(firsts, itertools.pairwise(bounds), lasts, strict=True)
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class DividedPeople(TrackedPeople):
    """People tracked through a recording, whose bodies can be smoothed window by window.

    Attributes:
        detections: detections in which people were tracked.
        options: options of the reconstruction.
        windows: the windows, in order.
        checkpoint: stores the tracker as it is before each window.
    """

    detections: Detections
    options: Options
    windows: tuple[Window, ...]
    checkpoint: Checkpoint

    @classmethod
    def of(
        cls,
        people: TrackedPeople,
        detections: Detections,
        options: Options,
        windows: tuple[Window, ...],
        checkpoint: Checkpoint,
    ) -> "DividedPeople":
        """Return people tracked with trackers stored before each window; see the attributes."""
        tracked = {field.name: getattr(people, field.name) for field in fields(TrackedPeople)}
        return cls(**tracked, detections=detections, options=options, windows=windows, checkpoint=checkpoint)

    def shared_priors(self) -> PathPriors | None:
        """Return the priors of the bodies' smoother, estimated from the whole recording, or None if it has none."""
        settings = self.history.settings
        return estimate_priors(self.history, settings) if settings.options.smoother == "full" else None

    def window_piece(
        self, window: Window, priors: PathPriors | None, rig: CameraRig, detections: Detections
    ) -> "WindowPiece":
        """Return what another process needs to smooth the bodies of a window.

        Args:
            window: the window.
            priors: the result of :meth:`shared_priors`.
            rig: the cameras that the model layer is compared with.
            detections: the detections of the whole recording that it is compared with.

        Raises:
            FileError: if the stored tracker is damaged or was removed.
        """
        first, last = window.first, window.last
        tracker = self.checkpoint.load(tracker_name(first))
        if tracker is None:
            raise FileError(
                f"The state of tracking before frame {self.history.numbers[first]}, which was stored, is damaged or "
                "was removed. Run the same command again to track people again."
            )
        naming = {
            number: tuple((place - first, name) for place, name in since) for number, since in self.naming.since.items()
        }
        if priors is not None:
            bodies = {
                number: [replace(each, start=each.start - first) for each in lengths]
                for number, lengths in priors.bodies.items()
            }
            priors = replace(priors, bodies=bodies)
        return WindowPiece(
            window=window,
            tracked=self.detections.frames(first, last),
            times_s=frame_times(self.detections)[first:last],
            chunk_frames=self.options.chunk_frames,
            tracker=tracker,
            tracks=self.tracks(first, last),
            naming=TrackNames(naming),
            nis=self.nis[first:last],
            nis_dof=self.nis_dof[first:last],
            shape_m=self.shape_m,
            shape_sd_m=self.shape_sd_m,
            priors=priors,
            rig=rig,
            detections=detections.frames(window.start, window.stop),
        )


@dataclass(frozen=True, eq=False)
class WindowPiece:
    """What determines the bodies of a window; frames count from the first one of the wider range.

    Attributes:
        window: the window.
        tracked: detections of the wider range, in which people were tracked.
        times_s: shape (frame,): their times.
        chunk_frames: number of frames of a chunk.
        tracker: tracker as it is before the wider range.
        tracks: assignment of detections to people in the wider range.
        naming: names of the tracks.
        nis: shape (frame, person): normalized innovation squared.
        nis_dof: shape (frame, person), int32: its degrees of freedom.
        shape_m: shape (person, shape): lengths of the bodies.
        shape_sd_m: shape (person, shape): their standard deviations.
        priors: priors of the bodies' smoother, or None.
        rig: cameras of the result.
        detections: detections of the window itself.
    """

    window: Window
    tracked: Detections
    times_s: np.ndarray
    chunk_frames: int
    tracker: ArticulatedTracker
    tracks: Tracks
    naming: TrackNames
    nis: np.ndarray
    nis_dof: np.ndarray
    shape_m: np.ndarray
    shape_sd_m: np.ndarray
    priors: PathPriors | None
    rig: CameraRig
    detections: Detections


def smooth_window(piece: WindowPiece) -> WindowBodies:
    """Track people through a window again and return their smoothed bodies.

    Raises:
        DetectionsError: if frames have no times.
    """
    found = continue_tracking(piece.tracker, piece.tracked, piece.times_s)
    # What is known of people's whole tracks, such as their names, replaces what the window shows.
    people = replace(
        found, recording_tracks=piece.tracks, naming=piece.naming, nis=piece.nis, nis_dof=piece.nis_dof,
        shape_m=piece.shape_m, shape_sd_m=piece.shape_sd_m, priors=lambda: piece.priors,
    )  # fmt: skip
    window = piece.window
    start = window.start - window.first
    smoother, parts = people.smoother(), []
    if start:
        smoother.take(start)
    for first, last in ranges(window.stop - window.start, piece.chunk_frames):
        detections, smoothed = piece.detections.frames(first, last), smoother.take(start + last)
        parts.append(people.bodies(piece.rig, detections, start + first, smoothed))
    return Layer.concatenate([layer for layer, _ in parts]), Poses.concatenate([poses for _, poses in parts])
