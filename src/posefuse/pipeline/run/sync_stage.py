"""Synchronize the views of a run by all evidence at hand."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from posefuse.errors import PosefuseError
from posefuse.io.cache import read_cached, write_cached
from posefuse.io.checkpoints import digest_of
from posefuse.io.files import replacing
from posefuse.io.options import sync_to_toml
from posefuse.model.cameras import CameraRig
from posefuse.model.clock_evidence import ClockEvidence
from posefuse.model.detections import Detections
from posefuse.model.options.sync import SyncOptions
from posefuse.pipeline.run.plan import RunPlan
from posefuse.pipeline.run.view_facts import shortest_s
from posefuse.pipeline.start_tag_evidence import start_tag_evidence
from posefuse.pipeline.sync_evidence import Synchronization, sound_evidence, start_times, synchronize
from posefuse.progress import Progress

_OVERLAP = 0.5
_CACHE = "sound"


@dataclass(frozen=True, eq=False)
class Synchronized:
    """The time offsets of a run's views.

    Attributes:
        sync: options with which the reconstruction corrects them.
        found: evidence of each source, or None if there is none.
        note: why nothing is known about the clocks; empty if something is.
    """

    sync: SyncOptions
    found: Synchronization | None = None
    note: str = ""


def hear(plan: RunPlan, names: Sequence[str], progress: Progress) -> tuple[ClockEvidence, ...]:
    """Return what the sound of the videos, and the tags of their start, show.

    Args:
        plan: the plan.
        names: names of the views in the keypoints.
        progress: receives the progress.
    """
    files, views = plan.choices.files_of_views, plan.images_of(names)
    videos = {name: plan.path(files[view.name]) for name, view in views.items() if view.is_video}
    if plan.choices.synchronize != "auto" or len(videos) < 2:
        return ()
    digests = plan.choices.inputs.digests
    known = {name: digests.get(files[views[name].name]) for name in videos}
    key = None if None in known.values() else digest_of({"videos": known, "posefuse": version("posefuse")})
    sound = _cached(key)
    if sound is None:
        sound = sound_evidence(videos, progress=progress)
        if key is not None:
            write_cached(_CACHE, key, {"evidence": np.array(json.dumps([asdict(each) for each in sound]))})
    return (*start_tag_evidence(videos, sound), *sound)


def _cached(key: str | None) -> tuple[ClockEvidence, ...] | None:
    """Return what the sound of videos showed before, so that an interrupted run does not listen to it twice."""
    cached = None if key is None else read_cached(_CACHE, key, ("evidence",))
    if cached is None:
        return None
    return tuple(ClockEvidence(**values) for values in json.loads(str(cached["evidence"])))


def known_starts(plan: RunPlan, sound: tuple[ClockEvidence, ...]) -> tuple[SyncOptions, ...]:
    """Return the start times of the views before the cameras are calibrated: by all evidence, then by sound alone."""
    if plan.choices.timestamps is not None:
        return (SyncOptions(),)
    found = (start_times(sound), start_times(tuple(each for each in sound if each.source == "sound")))
    return tuple(dict.fromkeys(found))


def measure(
    plan: RunPlan,
    rig: CameraRig,
    detections: Detections,
    sound: tuple[ClockEvidence, ...],
    progress: Progress,
) -> Synchronized:
    """Measure the time offsets of the views; where nothing shows them, the times are used as they are."""
    run = plan.choices
    stamps = None if run.timestamps is None else plan.path(run.timestamps).name
    # Views on one clock, or of videos of which one is short, cannot be far apart.
    reach_s = min(run.max_offset_s, max(_OVERLAP * shortest_s(plan.views), 0.1))
    if stamps is not None or not plan.views:
        reach_s = min(reach_s, 2.0)
    try:
        found = synchronize(rig, detections, sound, plan.options, timestamps=stamps, reach_s=reach_s, progress=progress)
    except PosefuseError as error:
        return Synchronized(SyncOptions(), note=f"The times of the views are used as they are. {error}")
    return Synchronized(found.sync, found)


def write_sync(sync: SyncOptions, path: Path) -> None:
    """Write time offsets; those that are synchronized have an empty table."""
    with replacing(path) as temporary:
        temporary.write_text(sync_to_toml(sync), "utf-8")
