"""``posefuse calibrate-noise``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, note, say, table
from posefuse.cli.reading import read_inputs
from posefuse.cli.types import CalibrationPath, KeypointsPath, OptionFlags, Recording, TimestampsPath
from posefuse.model.options.options import Options


def calibrate_noise(
    recording: Recording,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="TOML file to write.")] = Path("noise.toml"),
    calibration: CalibrationPath = None,
    keypoints: KeypointsPath = None,
    timestamps: TimestampsPath = None,
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Find how a detector errs, by leaving views out, and write it for reconstruct --options FILE.

    For each camera the scale of its errors, how they fall with confidence, and how heavy their tails are.
    """
    from posefuse.io.files import replacing
    from posefuse.io.options import noise_to_toml
    from posefuse.pipeline.reconstruct import calibrate_noise as calibrate
    from posefuse.pipeline.reconstruct import match_views

    progress = Bars()
    inputs = read_inputs(recording, calibration, keypoints, options, progress, timestamps)
    rig, _, _ = match_views(inputs.rig, inputs.detections, options)
    noise = calibrate(inputs.rig, inputs.detections, options, progress=progress)
    table(
        None,
        ["camera", "scale px"],
        [[name, f"{scale:.2f}"] for name, scale in zip(rig.names, noise.scale_px, strict=True)],
    )
    say(f"noise = scale / confidence^{noise.exponent:.2f}, px per axis")
    tails = "as good as normal" if noise.nu > 50 else "heavy" if noise.nu < 5 else "heavier than normal"
    say(f"tails: Student t with {noise.nu:.1f} degrees of freedom ({tails})")
    say(f"accepted detections spread {noise.spread:.2f} times as far; covariances count with it")
    if not noise.exponent > 0.1:
        note("note: the confidence says little about the errors of these detections.")
    with replacing(output) as temporary:
        temporary.write_text(noise_to_toml(noise, rig.names), "utf-8")
    note(f"Wrote {output}")
    say(f"Use it: posefuse reconstruct RECORDING --options {output}")
