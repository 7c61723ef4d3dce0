"""Track people through a recording or frame by frame: association and tracking wired together."""

from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.track_recording import track_people, track_subject
from posefuse.pipeline.people.tracked_people import TrackedPeople, WholeSmoother
from posefuse.pipeline.people.trackers import tracker_of, unused_options, warn_of_unused_options

__all__ = [
    "TrackedPeople",
    "WholeSmoother",
    "default_noise",
    "track_people",
    "track_subject",
    "tracker_of",
    "unused_options",
    "warn_of_unused_options",
]
