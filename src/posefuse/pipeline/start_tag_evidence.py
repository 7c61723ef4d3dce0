"""Coarse start times of views by the timecodes or creation times of their videos."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from posefuse.arguments import checked
from posefuse.io.videos.start_tags import StartKind, StartTags, read_start_tags
from posefuse.model.clock_evidence import ClockEvidence

TAG_SD_S = 1.0
"""Standard deviation of a start by a tag: clocks of cameras are set by hand, and creation times are whole seconds."""
_DAY_S = 86_400.0
_KINDS: tuple[StartKind, ...] = ("timecode", "creation time")


@checked
def start_tag_evidence(videos: Mapping[str, Path], sound: Sequence[ClockEvidence] = ()) -> tuple[ClockEvidence, ...]:
    """Return when views started by the tags of their videos: timecodes if two views have one, else creation times.

    Tags are good to about a second, so they only bring views near enough for sound or keypoints to be compared. Tags
    that are further apart than the videos last are no evidence, as their ``reason`` says.

    Args:
        videos: video of each view.
        sound: evidence by sound, whose clock the tags are moved to.

    Raises:
        FileError: if a video cannot be read.
    """
    tags = {name: read_start_tags(path) for name, path in videos.items() if path.is_file()}
    for kind in _KINDS:
        starts = {name: start for name, each in tags.items() if (start := each.of_kind(kind)) is not None}
        if len(starts) > 1:
            return _evidence(kind, starts, tags, {each.view: each.offset_s for each in sound if each.is_decisive})
    return ()


def _evidence(
    kind: StartKind, starts: Mapping[str, float], tags: Mapping[str, StartTags], heard: Mapping[str, float]
) -> tuple[ClockEvidence, ...]:
    """Return the evidence by one kind of tag."""
    times = np.array(list(starts.values()))
    late = times - times[0]
    if kind == "timecode":
        # Timecodes return to 0 at midnight.
        late = (late + 0.5 * _DAY_S) % _DAY_S - 0.5 * _DAY_S
    late -= late.min()
    known = [tags[name].duration_s for name in starts if tags[name].duration_s]
    if known and np.ptp(late) >= min(known):
        reason = (
            f"The {kind}s of the videos are up to {np.ptp(late):.0f} s apart, but the shortest video lasts "
            f"{min(known):.0f} s; they are not used."
        )
        return tuple(ClockEvidence(name, kind, float("nan"), float("nan"), 0.0, reason) for name in starts)
    both = [heard[name] - start for name, start in zip(starts, late, strict=True) if name in heard]
    late += float(np.median(both)) if both else 0.0
    return tuple(
        ClockEvidence(name, kind, float(start), TAG_SD_S, 0.0, f"The {kind} of its video.")
        for name, start in zip(starts, late, strict=True)
    )
