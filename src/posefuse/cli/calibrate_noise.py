"""``posefuse calibrate-noise``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, note, say, table
from posefuse.cli.types import CalibrationPath, KeypointsPath, OptionFlags, Overwrite, Recording, TimestampsPath
from posefuse.model.options.options import Options

_GAUSSIAN_NU, _HEAVY_NU, _MIN_EXPONENT = 50, 5, 0.1


def calibrate_noise(
    recording: Recording,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="TOML file to write.")] = Path("noise.toml"),
    calibration: CalibrationPath = None,
    keypoints: KeypointsPath = None,
    timestamps: TimestampsPath = None,
    overwrite: Overwrite = False,
    options: OptionFlags = Options(),  # noqa: B008
) -> None:
    """Estimate a detector's error model by leaving views out, and write it for reconstruct --options FILE.

    The error model has a scale per camera, an exponent of the confidence, and the heaviness of the tails.
    """
    from posefuse.io.files import replacing
    from posefuse.io.open_recording import RecordingInputs, open_recording
    from posefuse.io.options import noise_to_toml
    from posefuse.io.outputs import check_new_files
    from posefuse.pipeline.calibrate_noise import calibrate_noise as calibrate
    from posefuse.preprocess.match_cameras import match_views

    check_new_files([output], overwrite=overwrite)
    progress = Bars()
    opened = open_recording(recording, RecordingInputs(calibration, keypoints, timestamps), options, progress)
    rig, _, _ = match_views(opened.rig, opened.detections, options)
    noise = calibrate(opened.rig, opened.detections, options, progress=progress)
    table(
        None,
        ["camera", "scale px"],
        [[name, f"{scale:.2f}"] for name, scale in zip(rig.names, noise.scale_px, strict=True)],
    )
    say(f"noise = scale / confidence^{noise.exponent:.2f}, px per axis")
    tails = "nearly Gaussian" if noise.nu > _GAUSSIAN_NU else "heavy" if noise.nu < _HEAVY_NU else "moderately heavy"
    say(f"tails: Student t with {noise.nu:.1f} degrees of freedom ({tails})")
    note(f"Inlier residuals are {noise.spread:.2f} times the modeled noise; covariances are scaled accordingly.")
    if not noise.exponent > _MIN_EXPONENT:
        note("note: the confidence hardly predicts the errors of these detections.")
    with replacing(output) as temporary:
        temporary.write_text(noise_to_toml(noise, rig.names), "utf-8")
    note(f"Wrote {output}")
    say(f"Use it: posefuse reconstruct RECORDING --options {output}")
