"""``posefuse opensim``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, count, note, say, table, wrote
from posefuse.cli.types import Overwrite
from posefuse.errors import OptionsError
from posefuse.model.options.options import LayerName

if TYPE_CHECKING:
    from posefuse.pipeline.opensim import OpenSimOutcome

BUILT_IN = "rajagopal"
_SHOWN = ("pelvis_tilt", "lumbar_extension", "hip_flexion", "hip_adduction", "knee_angle", "ankle_angle", "elbow_flex")


def opensim(
    result: Annotated[tuple[Path, ...], Parameter(help="Folders of results or of runs, or reconstruction.nc files.")],
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for OpenSim's files.")],
    model: Annotated[
        str,
        Parameter(help="rajagopal (the full-body model without muscles), or an .osim file with its bodies to scale."),
    ] = BUILT_IN,
    layer: Annotated[LayerName | None, Parameter(help="Layer of the points; by default the best one.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Scale an OpenSim model for every person and run OpenSim's inverse kinematics.

    The command writes .osim, .trc and .mot files and compares OpenSim's angles with those of posefuse.

    Requires pip install 'posefuse[opensim]'.
    """
    if not result:
        raise OptionsError("Name at least one result: posefuse opensim RESULT --output FOLDER.")

    from posefuse.pipeline.opensim import opensim_results

    source = None if model == BUILT_IN else _model_file(model)
    outcomes, notes = opensim_results(list(result), output, source, layer, overwrite=overwrite, progress=Bars())
    for outcome in outcomes:
        _show(outcome)
    for text in notes:
        note(f"note: {text}")
    wrote(sorted(file.name for file in output.iterdir()), output)


def _model_file(model: str) -> Path:
    """Return the path of a model.

    Raises:
        OptionsError: if the name is neither the built-in model nor an ``.osim`` file.
    """
    if not model.endswith(".osim"):
        raise OptionsError(
            f"--model: expected {BUILT_IN} or an .osim file, got {model!r}. The model of Rajagopal et al. 2016 with "
            "muscles: https://simtk.org/projects/full_body."
        )
    return Path(model)


def _show(outcome: "OpenSimOutcome") -> None:
    """Print the agreement of the angles that most users look at."""
    say(
        f"{outcome.trial}, {outcome.person}: {count(outcome.n_frames, 'frame')}, markers "
        f"{1000 * outcome.marker_rms_m:.1f} mm RMS from the points"
    )
    rows = [
        [
            each.angle,
            f"{each.rmse_deg:.1f}",
            f"{each.bias_deg:+.1f}",
            _correlation(each.correlation),
            f"{outcome.points_sd_deg[each.angle]:.1f}",
        ]
        for each in outcome.comparison.angles
        if each.angle.removesuffix("_r").removesuffix("_l") in _SHOWN and each.angle not in outcome.followed
    ]
    table(None, ["OpenSim minus posefuse, degrees", "RMS", "bias", "r", "sd of points"], rows)
    if outcome.followed:
        note(f"The points do not determine {', '.join(outcome.followed)}, which follow the angles of posefuse.")


def _correlation(value: float) -> str:
    return "-" if value != value else f"{value:.2f}"
