"""Track people through a recording or frame by frame: association and tracking wired together.

Names are imported when they are first used, so that live tracking does not load what smooths and fits recordings.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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
_MODULE_OF = {
    "TrackedPeople": "tracked_people",
    "WholeSmoother": "tracked_people",
    "default_noise": "initial_noise",
    "track_people": "track_recording",
    "track_subject": "track_recording",
    "tracker_of": "trackers",
    "unused_options": "trackers",
    "warn_of_unused_options": "trackers",
}


def __getattr__(name: str) -> Any:
    if name in _MODULE_OF:
        return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
