"""``posefuse sync``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, note, say, table
from posefuse.cli.types import CalibrationPath, KeypointsPath, OptionFlags, Overwrite, Recording
from posefuse.model.options.options import Options


def sync(
    recording: Recording,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="TOML file to write.")] = Path("sync.toml"),
    calibration: CalibrationPath = None,
    keypoints: KeypointsPath = None,
    reference: Annotated[
        str | None, Parameter(help="Camera whose clock is correct; by default that of most views.")
    ] = None,
    reach_s: Annotated[float, Parameter(help="Largest time offset to search, in seconds.")] = 2.0,
    overwrite: Overwrite = False,
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Measure the time offset of each view to a fraction of a frame, for reconstruct --sync FILE.

    Offsets are estimated from how well the views agree about moving people. The recording itself is not changed, and
    reconstruct without --sync ignores the offsets.
    """
    from posefuse.cli.verdict import say_verdict
    from posefuse.io.files import replacing
    from posefuse.io.open_recording import RecordingInputs, open_recording
    from posefuse.io.options import sync_to_toml
    from posefuse.io.outputs import check_new_files
    from posefuse.pipeline.diagnose import judge_sync

    check_new_files([output], overwrite=overwrite)
    progress = Bars()
    inputs = RecordingInputs(calibration, keypoints)
    opened = open_recording(recording, inputs, options, progress, timed=options.rate_hz is None)
    timings, found, findings = judge_sync(
        opened.rig, opened.detections, options, reference=reference, reach_s=reach_s, progress=progress
    )
    rate = opened.detections.rate_hz or options.rate_hz
    unit, factor = ("frames", rate) if rate else ("ms", 1e3)
    rows = []
    for view in timings:
        for since, offset, drift in zip(view.start_s, view.offset_s, view.drift_ppm, strict=True):
            late, sd = f"{factor * offset:+.2f}", f"{factor * view.offset_sd_s:.2f}"
            if not view.is_observable and not view.is_wrong:
                late, sd = "unknown", "-"
            corrected = "yes" if view.camera in found.cameras else "no"
            rows.append([view.camera, f"{since:.1f}", late, sd, f"{drift:+.0f}" if drift else "-", corrected])
    table(None, ["camera", "from s", f"late, {unit}", "+-", "drift ppm", "corrected"], rows)
    if reference is None:
        note("Offsets are relative to the clock that most views share. --reference names another camera as correct.")
    note("A positive offset (+) means that the view captured its frames later than its timestamps indicate.")
    if not all(view.is_observable for view in timings):
        note("unknown: people who stand still do not show when a frame was captured. Film a person who walks.")
    say_verdict(findings)
    if found.does_nothing:
        say(f"Nothing to correct; {output} was not written.")
        return
    with replacing(output) as temporary:
        temporary.write_text(sync_to_toml(found), "utf-8")
    note(f"Wrote {output}")
    say(f"Use it: posefuse reconstruct RECORDING --sync {output}")
