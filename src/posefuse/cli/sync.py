"""``posefuse sync``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, note, say, table
from posefuse.cli.reading import must_have_rate, read_inputs
from posefuse.cli.types import CalibrationPath, KeypointsPath, OptionFlags, Recording
from posefuse.model.options.options import Options


def sync(
    recording: Recording,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="TOML file to write.")] = Path("sync.toml"),
    calibration: CalibrationPath = None,
    keypoints: KeypointsPath = None,
    reference: Annotated[
        str | None, Parameter(help="Camera whose clock is right; by default that of most views.")
    ] = None,
    reach_s: Annotated[float, Parameter(help="How late views may be, s.")] = 2.0,
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Measure how late each view is, to a fraction of a frame, from the 2D keypoints; for reconstruct --sync FILE.

    The views tell of each other's clocks by how well they agree about people who move. Nothing in the recording is
    changed: reconstruct without --sync is as before.
    """
    from posefuse.io.files import replacing
    from posefuse.io.options import sync_to_toml
    from posefuse.pipeline.diagnose import measure_sync

    progress = Bars()
    inputs = read_inputs(recording, calibration, keypoints, options, progress)
    if options.rate_hz is None:
        must_have_rate(inputs.detections)
    timings, found = measure_sync(
        inputs.rig, inputs.detections, options, reference=reference, reach_s=reach_s, progress=progress
    )
    rate = inputs.detections.rate_hz or options.rate_hz
    unit, factor = ("frames", rate) if rate else ("ms", 1e3)
    rows = []
    for view in timings:
        for since, late, drift in zip(view.start_s, view.offset_s, view.drift_ppm, strict=True):
            sd = f"{factor * view.offset_sd_s:.2f}"
            out = "yes" if view.camera in found.cameras else "no"
            rows.append([view.camera, f"{since:.1f}", f"{factor * late:+.2f}", sd, f"{drift:+.0f}", out])
    table(None, ["camera", "from s", f"late, {unit}", "+-", "drift ppm", "out of step"], rows)
    if reference is None:
        note("Offsets are from the clock that most views share. --reference names another that is right.")
    note("Late (+): the view took its frames later than it says. Early (-): earlier.")
    if found.does_nothing:
        say("All views are in step, as far as this recording tells.")
        say("What else may be wrong: posefuse inspect RECORDING --deep")
    with replacing(output) as temporary:
        temporary.write_text(sync_to_toml(found), "utf-8")
    note(f"Wrote {output}")
    say(f"Use it: posefuse reconstruct RECORDING --sync {output}")
