"""Synchronize views by all evidence at hand: timestamps of the cameras, sound, and keypoints."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from posefuse.arguments import checked
from posefuse.calibration.sound.views import time_by_sound
from posefuse.diagnostics.time_offsets import ViewTiming
from posefuse.errors import DetectionsError
from posefuse.io.videos.sound import read_sound
from posefuse.model.cameras import CameraRig
from posefuse.model.clock_evidence import ClockEvidence
from posefuse.model.detections import Detections
from posefuse.model.findings import Finding
from posefuse.model.options.options import Options
from posefuse.model.options.sync import SyncOptions
from posefuse.pipeline.diagnose import judge_sync
from posefuse.preprocess.match_cameras import match_views
from posefuse.preprocess.start_times import with_start_times
from posefuse.progress import Progress, Silent

TIMESTAMP_SD_S = 0.001
"""Standard deviation of frame times that the cameras or the recording program wrote."""
_SIGNIFICANT_Z = 3.0
_CONTRADICTION_Z, _CONTRADICTION_S = 4.0, 0.02
"""Sources contradict each other if their offsets differ by more than both."""


@checked
@dataclass(frozen=True, eq=False)
class Synchronization:
    """The time offsets of the views, and what they rest on.

    Attributes:
        sync: options with which :func:`reconstruct` corrects the views; empty if there is nothing to correct.
        starts: the part of ``sync`` that the sound determines.
        evidence: what each source shows, by view.
        contradictions: a sentence for each contradiction between sources.
        timings: timing of each view by the keypoints; empty without a calibration or keypoints.
        findings: findings of the recording check; empty without a calibration or keypoints.
        rate_hz: frame rate of the keypoints, or None.
    """

    sync: SyncOptions
    starts: SyncOptions
    evidence: tuple[ClockEvidence, ...]
    contradictions: tuple[str, ...] = ()
    timings: tuple[ViewTiming, ...] = ()
    findings: tuple[Finding, ...] = ()
    rate_hz: float | None = None

    @property
    def unknown(self) -> tuple[str, ...]:
        """Views of which no source shows when they captured their frames."""
        by_keypoints = {each.camera: each.is_observable or each.is_corrected for each in self.timings}
        known = {each.view for each in self.evidence if each.is_decisive} | set(self.sync.cameras)
        views = dict.fromkeys([*by_keypoints, *(each.view for each in self.evidence)])
        return tuple(view for view in views if not by_keypoints.get(view, False) and view not in known)

    @checked
    def of(self, view: str) -> tuple[ClockEvidence, ...]:
        """Return the evidence on one view."""
        return tuple(each for each in self.evidence if each.view == view)


@checked
def sound_evidence(
    videos: Mapping[str, Path], *, reference: str | None = None, progress: Progress | None = None
) -> tuple[ClockEvidence, ...]:
    """Measure the time offsets of views by the sound of their videos.

    Videos may start any time apart and have different frame rates, microphones and sampling clocks. Times count from
    the first image of each video; the different start of its sound is respected.

    Args:
        videos: video, or sound file, of each view.
        reference: view whose clock is correct; by default the one that started first.
        progress: receives the progress.

    Returns:
        The evidence on each view. Views without sound, with silence, or with sound that no other view recorded have
        no offset, and their ``reason`` says why.

    Raises:
        FileError: if a video cannot be read.
    """
    progress = progress or Silent()
    progress.start("reading sound", len(videos))
    sounds = []
    for name, path in videos.items():
        sounds.append(read_sound(path, name))
        progress.advance(1)
    progress.finish()
    return time_by_sound(sounds, reference, progress)


def start_times(starts: Sequence[ClockEvidence]) -> SyncOptions:
    """Return options that correct the views whose sound, or else whose tags, show a significant time offset."""
    rows = [
        (each.view, 0.0, each.offset_s, each.drift_ppm)
        for each in _decisive(starts).values()
        if (abs(each.offset_s) > _SIGNIFICANT_Z * each.sd_s or each.drift_ppm)
    ]
    return SyncOptions(*zip(*rows, strict=True)) if rows else SyncOptions()


def _decisive(starts: Sequence[ClockEvidence]) -> dict[str, ClockEvidence]:
    """Return the evidence on the start of each view that has any: by its sound, or else by the tags of its video."""
    found = {each.view: each for each in starts if each.is_decisive}
    return found | {each.view: each for each in _sounds(starts) if each.is_decisive}


def _sounds(starts: Sequence[ClockEvidence]) -> tuple[ClockEvidence, ...]:
    return tuple(each for each in starts if each.source == "sound")


@checked
def synchronize(
    rig: CameraRig | None,
    detections: Detections | None,
    sound: Sequence[ClockEvidence] = (),
    options: Options | None = None,
    *,
    timestamps: str | None = None,
    reference: str | None = None,
    reach_s: float = 2.0,
    progress: Progress | None = None,
) -> Synchronization:
    """Combine the evidence on the clocks of all views.

    Frame times that the cameras wrote are kept, and sound is only compared with them. Without them, sound gives the
    start of each view; where there is none, the tags of the videos bring the views near. Keypoints then show what
    remains, to a fraction of a frame; where they contradict the sound or the tags, they decide, because they show when
    the images were taken.

    Args:
        rig: calibrated cameras, or None.
        detections: 2D keypoints, or None.
        sound: evidence of :func:`sound_evidence`, and of :func:`start_tag_evidence`, by the name of the view.
        options: options as of :func:`reconstruct`; those that assign detections to people are used.
        timestamps: name of the file from which the frame times come, or None if they follow from a frame rate.
        reference: camera whose clock is correct; by default that of most views.
        reach_s: largest time offset that keypoints are searched for, in s.
        progress: receives the progress.

    Raises:
        MatchError: if views and cameras do not match, or the reference does not exist.
        DetectionsError: if there is no sound, and keypoints do not determine the offsets.
    """
    options, progress = options or Options(), progress or Silent()
    if rig is None or detections is None:
        starts = start_times(_sounds(sound))
        return Synchronization(starts, starts, tuple(sound))
    views = _Views.of(rig, detections, sound, options)
    starts = SyncOptions() if timestamps is not None else start_times(views.sound)
    base = tuple(views.sound) + _timestamp_evidence(views, timestamps)
    judged = _judge(views, starts, options, reference, reach_s, progress)
    contradictions: list[str] = []
    # Tags are weak evidence, so keypoints are always asked without them, too.
    by_tags = any(each.view in starts.cameras for each in _decisive(views.sound).values() if each.source != "sound")
    if not starts.does_nothing and (by_tags or judged.error is not None or judged.contradicts(views.sound)):
        unshifted = _judge(views, SyncOptions(), options, reference, reach_s, progress)
        if unshifted.is_better_than(judged, compared=by_tags):
            contradictions.append(_unused_starts(views.sound))
            judged, starts = unshifted, SyncOptions()
    if judged.error is not None:
        # Tags alone are too coarse.
        starts = start_times(_sounds(views.sound)) if by_tags else starts
        if not any(each.is_decisive for each in _sounds(views.sound)):
            raise judged.error
        keypoints = tuple(_no_evidence(name, str(judged.error)) for name in views.names)
        found = (*_tag_contradictions(views.sound), *_timestamp_contradictions(views, timestamps))
        return Synchronization(starts, starts, (*base, *keypoints), found)
    keypoints = _keypoint_evidence(views, starts, judged.timings)
    if not contradictions and timestamps is None:
        contradictions += _contradictions(views, starts, judged.timings)
    contradictions += [*_tag_contradictions(views.sound), *_timestamp_contradictions(views, timestamps)]
    return Synchronization(
        _combined(_refined(starts, views.sound, judged.timings), judged.sync),
        starts,
        (*base, *keypoints),
        tuple(contradictions),
        judged.timings,
        judged.findings,
    )


@dataclass(frozen=True, eq=False)
class _Views:
    """The matched views: detections by the names of their cameras, and their sound."""

    rig: CameraRig
    detections: Detections
    sound: tuple[ClockEvidence, ...]

    @property
    def names(self) -> tuple[str, ...]:
        return self.rig.names

    @classmethod
    def of(cls, rig: CameraRig, detections: Detections, sound: Sequence[ClockEvidence], options: Options) -> "_Views":
        if options.rate_hz is not None and detections.rate_hz is None:
            detections = detections.with_rate(options.rate_hz)
        rig, detections, _ = match_views(rig, detections, options)
        # Sound may be named after the view or after its camera.
        camera_of = dict(zip(detections.view_names, rig.names, strict=True)) | {name: name for name in rig.names}
        named = [replace(each, view=camera_of[each.view]) for each in sound if each.view in camera_of]
        return cls(rig, replace(detections, view_names=rig.names), tuple(named))


@dataclass(frozen=True, eq=False)
class _Judged:
    """The verdict of the keypoints, or the error that tells why there is none."""

    timings: tuple[ViewTiming, ...] = ()
    sync: SyncOptions = SyncOptions()  # noqa: RUF009
    findings: tuple[Finding, ...] = ()
    error: DetectionsError | None = None

    def is_better_than(self, shifted: "_Judged", *, compared: bool) -> bool:
        """Return whether views agree at their own times, or, if ``compared``, with fewer faults than at other times."""
        if self.error is not None:
            return False
        if shifted.error is not None or self.sync.does_nothing:
            return True
        return compared and self.n_faults < shifted.n_faults

    @property
    def n_faults(self) -> int:
        """Number of findings beside time offsets, which are corrected."""
        return sum(finding.kind != "time offset" for finding in self.findings)

    def contradicts(self, sound: Sequence[ClockEvidence]) -> bool:
        """Return whether a view still has an offset that its sound does not explain."""
        heard = {view: each.sd_s for view, each in _decisive(sound).items()}
        return any(
            timing.is_corrected
            and timing.camera in heard
            and _differs(timing.offset_s[0], float(np.hypot(timing.offset_sd_s, heard[timing.camera])))
            for timing in self.timings
        )


def _judge(
    views: _Views, starts: SyncOptions, options: Options, reference: str | None, reach_s: float, progress: Progress
) -> _Judged:
    """Return what the keypoints show after the views are moved to their start times."""
    chosen = replace(options, camera_order=(), cameras=(), exclude_camera=())
    try:
        shifted = with_start_times(views.detections, starts)
        timings, sync, findings = judge_sync(
            views.rig, shifted, chosen, reference=reference, reach_s=reach_s, progress=progress
        )
    except DetectionsError as error:
        return _Judged(error=error)
    return _Judged(timings, sync, findings)


def _timestamp_evidence(views: _Views, source: str | None) -> tuple[ClockEvidence, ...]:
    if source is None:
        return ()
    reason = f"Its frame times come from {source}."
    return tuple(ClockEvidence(name, "timestamps", 0.0, TIMESTAMP_SD_S, 0.0, reason) for name in views.names)


def _keypoint_evidence(views: _Views, starts: SyncOptions, timings: Sequence[ViewTiming]) -> tuple[ClockEvidence, ...]:
    """Return the whole offset of each view by the keypoints: its start and what remains."""
    found = []
    for name in views.names:
        timing = next((each for each in timings if each.camera == name), None)
        if timing is None:
            found.append(_no_evidence(name, f"{name} shares too few people with the other views."))
        elif not timing.is_observable and not timing.is_corrected:
            found.append(_no_evidence(name, f"The people of {name} move too little to show when a frame was captured."))
        else:
            total_s = float(starts.offset_at(name, np.array(0.0))) + timing.offset_s[0]
            reason = f"Measured to {1e3 * timing.offset_sd_s:.1f} ms by people who move."
            found.append(ClockEvidence(name, "keypoints", total_s, timing.offset_sd_s, timing.drift_ppm[0], reason))
    return tuple(found)


def _no_evidence(view: str, reason: str) -> ClockEvidence:
    return ClockEvidence(view, "keypoints", float("nan"), float("nan"), 0.0, reason)


def _contradictions(views: _Views, starts: SyncOptions, timings: Sequence[ViewTiming]) -> list[str]:
    """Return the views whose keypoints show another offset than their sound."""
    sound = _decisive(views.sound)
    found = []
    for timing in timings:
        heard = sound.get(timing.camera)
        if heard is None or not (timing.is_corrected and timing.is_observable):
            continue
        rest_s = timing.offset_s[0]
        if timing.camera not in starts.cameras:
            rest_s -= heard.offset_s
        if _differs(rest_s, float(np.hypot(timing.offset_sd_s, heard.sd_s))):
            source = heard.source
            found.append(
                f"{source.capitalize()} and keypoints contradict each other in {timing.camera}: the keypoints show it "
                f"{1e3 * abs(rest_s):.0f} ms {'later' if rest_s > 0 else 'earlier'} than the {source}. The keypoints "
                "are used."
            )
    return found


def _unused_starts(starts: Sequence[ClockEvidence]) -> str:
    """Return why start times are not used that keypoints contradict."""
    if any(each.is_decisive for each in _sounds(starts)):
        return (
            "The keypoints of the views agree at their own times, but not at the times by the sound; the sound is not "
            "used. Do the videos contain the original sound?"
        )
    kind = next(each.source for each in starts if each.is_decisive)
    return f"The keypoints of the views agree at their own times, but not at those by the {kind}, which is not used."


def _tag_contradictions(starts: Sequence[ClockEvidence]) -> tuple[str, ...]:
    """Return the views whose tags differ from their sound, and why tags are not used."""
    tags = [each for each in starts if each.source in ("timecode", "creation time")]
    heard = {each.view: each.offset_s for each in _sounds(starts) if each.is_decisive}
    unused = dict.fromkeys(each.reason for each in tags if not each.is_decisive)
    return (
        *unused,
        *(
            f"The {each.source} of {each.view} is {abs(each.offset_s - heard[each.view]):.0f} s "
            f"{'later' if each.offset_s > heard[each.view] else 'earlier'} than its sound shows. The sound is used."
            for each in tags
            if each.view in heard and _differs(each.offset_s - heard[each.view], each.sd_s)
        ),
    )


def _timestamp_contradictions(views: _Views, timestamps: str | None) -> tuple[str, ...]:
    """Return the views whose sound shows another offset than their timestamps; offsets count from the common one."""
    sound = [each for each in _sounds(views.sound) if each.is_decisive]
    if timestamps is None or len(sound) < 2:
        return ()
    common_s = float(np.median([each.offset_s for each in sound]))
    return tuple(
        f"Sound and timestamps contradict each other in {each.view}: by its sound, it was recorded "
        f"{1e3 * abs(each.offset_s - common_s):.0f} ms {'later' if each.offset_s > common_s else 'earlier'} than "
        f"{timestamps} states. The timestamps are used."
        for each in sound
        if _differs(each.offset_s - common_s, each.sd_s)
    )


def _differs(difference_s: float, sd_s: float) -> bool:
    return abs(difference_s) > max(_CONTRADICTION_Z * sd_s, _CONTRADICTION_S)


def _refined(starts: SyncOptions, sound: Sequence[ClockEvidence], timings: Sequence[ViewTiming]) -> SyncOptions:
    """Return the start times with what the keypoints show in addition, weighted by the standard deviations."""
    sds = {view: each.sd_s for view, each in _decisive(sound).items()}
    offsets = list(starts.offset_s)
    for row, camera in enumerate(starts.cameras):
        timing = next((each for each in timings if each.camera == camera), None)
        if timing is not None and timing.is_observable and not timing.is_corrected:
            share = sds[camera] ** 2 / (sds[camera] ** 2 + timing.offset_sd_s**2)
            offsets[row] += share * timing.offset_s[0]
    return replace(starts, offset_s=tuple(offsets))


def _combined(starts: SyncOptions, rest: SyncOptions) -> SyncOptions:
    """Return the offsets of both: the rows of the rest, which count times after the start, on the views' own clocks."""
    rows = []
    for camera, since_s, offset_s, drift_ppm in zip(
        rest.cameras, rest.start_s, rest.offset_s, rest.drift_ppm, strict=True
    ):
        start_s = float(starts.offset_at(camera, np.array(since_s)))
        own_s = since_s - start_s if since_s else 0.0
        drift = sum(d for name, d in zip(starts.cameras, starts.drift_ppm, strict=True) if name == camera)
        rows.append((camera, own_s, offset_s + float(starts.offset_at(camera, np.array(own_s))), drift_ppm + drift))
    rows += [
        row
        for row in zip(starts.cameras, starts.start_s, starts.offset_s, starts.drift_ppm, strict=True)
        if row[0] not in rest.cameras
    ]
    return SyncOptions(*zip(*rows, strict=True)) if rows else SyncOptions()
