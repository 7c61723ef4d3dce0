"""Many people followed through a recording, or frame by frame: association and tracking wired together."""

from posefuse.following.followed import Followed, WholeSmoother
from posefuse.following.noise import usual_noise
from posefuse.following.recording import follow, follow_subject
from posefuse.following.trackers import idle_options, tracker_of, warn_of_idle

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
