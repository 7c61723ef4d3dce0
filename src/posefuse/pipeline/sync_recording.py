"""Synchronize the views of a recording's folder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from posefuse.arguments import checked
from posefuse.errors import DetectionsError, FileError, MatchError, choices
from posefuse.io.open_recording import RecordingInputs, calibration_and_keypoints, open_recording, timestamps_in
from posefuse.io.recording import find_recording
from posefuse.io.videos.find import find_videos, videos_of_views
from posefuse.io.videos_only import videos_only
from posefuse.model.cameras import CameraRig
from posefuse.model.clock_evidence import ClockEvidence
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.pipeline.start_tag_evidence import start_tag_evidence
from posefuse.pipeline.sync_evidence import Synchronization, sound_evidence, synchronize
from posefuse.progress import Progress, Silent

Sources = Literal["all", "keypoints", "sound"]


@checked
@dataclass(frozen=True)
class SyncRequest:
    """What to synchronize a recording by.

    Attributes:
        inputs: paths of inputs that are not found in the folder or are ambiguous there.
        options: options as of :func:`reconstruct`; those that assign detections to people are used.
        videos: video or sound file of each view; by default the videos in the folder that are named after views.
        evidence: sources to use.
        reference: camera whose clock is correct; by default that of most views.
        reach_s: largest time offset that keypoints are searched for, in s.
    """

    inputs: RecordingInputs = field(default_factory=RecordingInputs)
    options: Options = field(default_factory=Options)
    videos: Mapping[str, Path] = field(default_factory=dict)
    evidence: Sources = "all"
    reference: str | None = None
    reach_s: float = 2.0


@checked
def sync_recording(
    folder: str | Path, request: SyncRequest | None = None, progress: Progress | None = None
) -> Synchronization:
    """Measure the time offsets of a recording's views by all evidence in its folder, see :func:`synchronize`.

    Videos alone are synchronized by their sound. Keypoints give evidence with a calibration only.

    Raises:
        PosefuseError: if an input is missing, ambiguous or broken, or nothing determines the offsets.
    """
    request, progress, folder = request or SyncRequest(), progress or Silent(), Path(folder)
    rig, detections, source = _keypoint_inputs(folder, request, progress)
    views = () if detections is None else detections.view_names
    videos = dict(request.videos) or _videos_in(folder, views)
    sound = ()
    if request.evidence != "keypoints" and videos:
        known = request.reference if request.reference in videos else None
        sound = sound_evidence(videos, reference=known, progress=progress)
        if request.evidence == "all":
            sound = (*start_tag_evidence(videos, sound), *sound)
        if request.reference is not None and known is None and rig is None:
            raise MatchError(f"`reference`: there is no view {request.reference!r}. The views are {choices(videos)}.")
    if rig is None and not any(each.is_decisive and each.source == "sound" for each in sound):
        why = _why(videos, [each.reason for each in sound if each.source == "sound" or not each.is_decisive])
        why += _by_tags(sound)
        advice = (videos_only(folder) or "") if detections is None else ""
        raise DetectionsError(f"Nothing shows the time offsets of the views. {why} {advice}".rstrip())
    found = synchronize(
        rig, detections, sound, request.options, timestamps=source, reference=request.reference,
        reach_s=request.reach_s, progress=progress,
    )  # fmt: skip
    rate_hz = None if detections is None else detections.rate_hz or request.options.rate_hz
    return replace(found, rate_hz=rate_hz)


def _videos_in(folder: Path, views: tuple[str, ...]) -> dict[str, Path]:
    if views:
        return videos_of_views(folder, views)
    return {path.stem: path for path in find_videos(folder)}


def _why(videos: Mapping[str, Path], reasons: list[str]) -> str:
    if not videos:
        return "There are no videos; name them with `video`."
    if len(videos) == 1:
        return "There is one video; two or more are compared."
    return " ".join(dict.fromkeys(reasons))


def _by_tags(evidence: Sequence[ClockEvidence]) -> str:
    """Return what the tags of the videos show, which is too coarse alone."""
    tags = [each for each in evidence if each.is_decisive and each.source != "sound"]
    if not tags:
        return ""
    starts = ", ".join(f"{each.view} {each.offset_s:+.1f} s" for each in tags)
    return f" The {tags[0].source}s of the videos show their starts to about a second: {starts}; keypoints are needed."


def _keypoint_inputs(
    folder: Path, request: SyncRequest, progress: Progress
) -> tuple[CameraRig | None, Detections | None, str | None]:
    """Return the cameras, the keypoints, and the file of their frame times; all None for videos alone."""
    inputs, options = request.inputs, request.options
    if request.evidence == "sound":
        return None, None, None
    if inputs.calibration is None and inputs.keypoints is None and request.evidence == "all":
        if folder.is_file():
            raise FileError(f"{folder} is a file. Specify the folder of the recording.")
        found = find_recording(folder)
        if not (found.calibrations and found.keypoints) and (request.videos or find_videos(folder)):
            return None, None, None
    opened = open_recording(folder, inputs, options, progress, timed=options.rate_hz is None)
    source = inputs.timestamps
    if source is None:
        source = timestamps_in(folder, calibration_and_keypoints(folder, inputs, options)[1], options)
    return opened.rig, opened.detections, None if source is None else source.name
