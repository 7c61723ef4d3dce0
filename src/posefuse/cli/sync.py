"""``posefuse sync``."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_args

from cyclopts import Parameter

from posefuse.cli.console import Bars, note, say, table, warn
from posefuse.cli.types import OptionFlags, Overwrite, Recording, SyncedInputFlags, SyncedInputs, with_sync
from posefuse.cli.videos import Videos
from posefuse.model.clock_evidence import EvidenceSource
from posefuse.model.options.options import Options

if TYPE_CHECKING:
    from posefuse.pipeline.sync_evidence import Synchronization


@dataclass(frozen=True)
class _Measurement:
    """Flags of how offsets are measured."""

    video: Videos = ()
    evidence: Annotated[
        Literal["all", "keypoints", "sound"], Parameter(help="Sources from which time offsets are measured.")
    ] = "all"
    reference: Annotated[
        str | None, Parameter(help="Camera whose clock is correct; by default that of most views.")
    ] = None
    reach_s: Annotated[
        float, Parameter(help="Largest time offset to search by keypoints, in seconds; sound has no limit.")
    ] = 2.0


def sync(
    recording: Recording,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="TOML file to write.")] = Path("sync.toml"),
    inputs: SyncedInputs = SyncedInputFlags(),  # noqa: B008
    measurement: Annotated[_Measurement, Parameter(name="*")] = _Measurement(),
    overwrite: Overwrite = False,
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Measure the time offset of each view to a fraction of a frame, for reconstruct --sync FILE.

    Offsets are estimated from the sound of the videos, if there are any, and from how well the views agree about moving
    people. The recording itself is not changed, and reconstruct without --sync ignores the offsets. With --sync, the
    command measures by keypoints what an earlier file leaves, and writes nothing.
    """
    from posefuse.cli.verdict import say_verdict
    from posefuse.cli.videos import files_by_name
    from posefuse.io.files import replacing
    from posefuse.io.options import sync_to_toml
    from posefuse.io.outputs import check_new_files
    from posefuse.pipeline.sync_recording import SyncRequest, sync_recording

    options = with_sync(options, inputs.sync)
    again = not options.sync.does_nothing
    if not again:
        check_new_files([output], overwrite=overwrite)
    request = SyncRequest(
        inputs.paths(),
        options,
        files_by_name(measurement.video),
        "keypoints" if again else measurement.evidence,
        measurement.reference,
        measurement.reach_s,
    )
    found = sync_recording(recording, request, Bars())
    if found.timings:
        _show_timings(found)
    _show_evidence(found)
    if measurement.reference is None and found.timings:
        note("Offsets are relative to the clock that most views share. --reference names another camera as correct.")
    elif measurement.reference is None:
        note("Offsets are relative to the view that started first. --reference names another camera as correct.")
    note("A positive offset (+) means that the view captured its frames later than its timestamps indicate.")
    if not all(view.is_observable for view in found.timings):
        note("unknown: people who stand still do not show when a frame was captured. Film a person who walks.")
    for sentence in found.contradictions:
        warn(sentence)
    if found.timings:
        say_verdict(found.findings)
    if again:
        which = "No" if found.sync.does_nothing else "These"
        say(f"{which} offsets remain after the correction. A complete file is written without --sync.")
        return
    with replacing(output) as temporary:
        temporary.write_text(sync_to_toml(found.sync), "utf-8")
    if found.sync.does_nothing:
        say("Nothing to correct.")
    note(f"Wrote {output}")
    say(f"Use it: posefuse reconstruct RECORDING --sync {output}")


def _show_timings(found: "Synchronization") -> None:
    """Print what the keypoints show, row by row; views move to the start times of their sound before."""
    unit, factor = ("frames", found.rate_hz) if found.rate_hz else ("ms", 1e3)
    rows = []
    for view in found.timings:
        for since, offset, drift in zip(view.start_s, view.offset_s, view.drift_ppm, strict=True):
            late, sd = f"{factor * offset:+.2f}", f"{factor * view.offset_sd_s:.2f}"
            if not view.is_observable and not view.is_corrected:
                late, sd = "unknown", "-"
            corrected = "yes" if view.is_corrected else "no"
            rows.append([view.camera, f"{since:.1f}", late, sd, f"{drift:+.0f}" if drift else "-", corrected])
    if not found.starts.does_nothing:
        note("By keypoints, after the views are moved to the start times of their sound:")
    table(None, ["camera", "from s", f"late, {unit}", "+-", "drift ppm", "corrected"], rows)


def _show_evidence(found: "Synchronization") -> None:
    """Print the offset of each view by each source, if there is another one than keypoints."""
    sources = [name for name in get_args(EvidenceSource) if any(e.source == name for e in found.evidence)]
    if sources == ["keypoints"]:
        return
    views = list(dict.fromkeys(each.view for each in found.evidence))
    by_source = {(each.view, each.source): each for each in found.evidence}
    rows, reasons = [], []
    for view in views:
        row, shown = [view], False
        for source in sources:
            each = by_source.get((view, source))
            decisive = each is not None and each.is_decisive
            row.append(f"{each.offset_s:+.3f} +- {each.sd_s:.3f}" if each and decisive else "no evidence")
            shown |= bool(decisive)
            if each is not None and not decisive:
                reasons.append(f"{source}: {each.reason}")
        used = [offset for name, offset in zip(found.sync.cameras, found.sync.offset_s, strict=True) if name == view]
        rows.append([*row, f"{used[0]:+.3f}" if used else "0" if shown else "unknown"])
    table("late, in s, by each source", ["camera", *sources, "used"], rows)
    for reason in dict.fromkeys(reasons):
        note(reason)
