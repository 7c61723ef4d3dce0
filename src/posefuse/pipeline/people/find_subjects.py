"""Assign the detections of a recording to people."""

import warnings
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from posefuse.association.one_subject import NO_PERSON, SingleSubject, longest_subject
from posefuse.checkpoint import NO_CHECKPOINT, Checkpoint
from posefuse.errors import DetectionsError, OptionsError, PosefuseWarning
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.subjects import Subjects
from posefuse.model.tracks import TrackState
from posefuse.parallel import ONE_JOB, Jobs
from posefuse.pipeline.people.stills import STILLS, associate_stills
from posefuse.pipeline.people.track_recording import track_people, track_subject, warn_of_interruption
from posefuse.pipeline.people.tracked_people import TrackedPeople
from posefuse.pipeline.people.trackers import warn_of_unused_options
from posefuse.progress import Progress

FindSubjects = Callable[[CameraRig, Detections, Options, Progress], tuple[Subjects, TrackedPeople | None]]
"""Assigns detections to people and fits bodies where the options ask for them, as :func:`find_subjects` does."""


class FindStoredSubjects(Protocol):
    """A :data:`FindSubjects` that stores the state of tracking."""

    def __call__(
        self, rig: CameraRig, detections: Detections, options: Options, progress: Progress, checkpoint: Checkpoint
    ) -> tuple[Subjects, TrackedPeople | None]:
        """Return the assignment of detections to people, and their fitted bodies, if any."""
        ...


def find_subjects(
    rig: CameraRig,
    detections: Detections,
    options: Options,
    progress: Progress,
    checkpoint: Checkpoint = NO_CHECKPOINT,
    jobs: Jobs = ONE_JOB,
    stored: Sequence[int] = (),
) -> tuple[Subjects, TrackedPeople | None]:
    """Return the assignment of detections to people, and their fitted bodies, if any.

    Args:
        rig: calibrated cameras.
        detections: detections of the recording.
        options: options with ``people`` resolved.
        progress: receives the progress.
        checkpoint: stores the state of tracking.
        jobs: as of :func:`track_people`.
        stored: indices of frames before which the tracker of many people is stored; see :func:`track_people`.

    Raises:
        DetectionsError: if one subject is requested and a view shows several people without a choice among them, or
            people are tracked and frames have no times.
        OptionsError: if the options select a person who does not exist.
        SkeletonError: if bodies are requested and the skeleton has no kinematic tree.
    """
    if options.people == "many" or options.bodies == "fit":
        warn_of_unused_options(options, detections.skeleton)
    if options.people == "many":
        people = track_people(rig, detections, options, progress, checkpoint, jobs=jobs, stored=stored)
        if not stored:  # A divided recording has no partial result.
            warn_of_interruption(people, detections)
        people = people.only(options.person) if options.person else people
        return people, None if options.bodies == "none" else people
    if options.people == STILLS:
        return associate_stills(rig, detections, options, progress), None
    subject = _find_subject(rig, detections, options, progress, checkpoint)
    if options.bodies != "fit":
        return subject, None
    if len(rig) == 1:
        raise OptionsError("bodies = 'fit' needs two cameras or more; this rig has one.")
    tracked = track_subject(rig, detections, subject, options, progress, checkpoint, jobs=jobs)
    warn_of_interruption(tracked, detections)
    if not tracked.recording_tracks.person_ids:
        raise DetectionsError(
            "bodies = 'fit' found no frame in which two cameras show the subject well enough to initialize the body. "
            "Check the "
            "measured points first (bodies = 'auto')."
        )
    return subject, tracked


def _find_subject(
    rig: CameraRig, detections: Detections, options: Options, progress: Progress, checkpoint: Checkpoint
) -> SingleSubject:
    """Return the single subject: of several people without ``pick``, the one in the common volume."""
    several = bool((detections.people_counts > 1).any())
    if not several or options.pick is not None or len(rig) == 1:
        return SingleSubject.of(detections, options.pick)
    people = track_people(rig, detections, options, progress, checkpoint.child("everyone"))
    if people.n_frames < detections.n_frames:  # interrupted: the rest decides who the subject is
        raise KeyboardInterrupt
    return longest_subject(rig, detections, people.recording_tracks)


def people_notes(detections: Detections, subjects: Subjects, options: Options) -> tuple[str, ...]:
    """Return a note, and warn, if there is no person; or a note if the views show another number than are tracked.

    Several views may show different people, so more people than a view shows are noted only beyond what any view shows.
    """
    if not subjects.tracks(0, 0).person_ids:
        warnings.warn(NO_PERSON, PosefuseWarning, stacklevel=5)
        return (NO_PERSON,)
    n_frames = frames_tracked(subjects) or detections.n_frames
    if options.people != "many" or options.person or not n_frames:
        return ()
    shown = detections.people_counts[:n_frames].max(axis=1)
    tracked = (np.asarray(subjects.tracks(0, n_frames).state) != TrackState.ABSENT).sum(axis=1)
    if np.median(shown) <= np.median(tracked) <= shown.max():
        return ()
    return (
        f"People tracked at a time: {np.median(tracked):g}; people in a view: {np.median(shown):g} (medians over the "
        "frames). The options of association and tracker decide which detections become people.",
    )


def frames_tracked(subjects: Subjects) -> int | None:
    """Return the number of frames through which people were tracked; None where that does not apply."""
    return subjects.n_frames if isinstance(subjects, TrackedPeople) else None
