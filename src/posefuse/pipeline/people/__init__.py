"""Many people followed through a recording, or frame by frame: association and tracking wired together."""

from posefuse.pipeline.people.initial_noise import usual_noise
from posefuse.pipeline.people.track_recording import follow, follow_subject
from posefuse.pipeline.people.tracked_people import Followed, WholeSmoother
from posefuse.pipeline.people.trackers import idle_options, tracker_of, warn_of_idle

__all__ = [
    "Followed",
    "WholeSmoother",
    "follow",
    "follow_subject",
    "idle_options",
    "tracker_of",
    "usual_noise",
    "warn_of_idle",
]
