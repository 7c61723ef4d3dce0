"""``posefuse simulate``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from posefuse.cli.console import say, wrote
from posefuse.cli.types import Overwrite
from posefuse.synthetic.options import SceneOptions

if TYPE_CHECKING:
    from posefuse.synthetic.crowds import CrowdScene
    from posefuse.synthetic.scenes import Scene

CALIBRATION = "calibration.toml"
KEYPOINTS = "keypoints.nc"
TRUTH = "truth.nc"


def simulate(
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for the recording.")],
    *,
    overwrite: Overwrite = False,
    scene: Annotated[SceneOptions, Parameter(name="*", group="Scene")] = SceneOptions(),  # noqa: B008
) -> None:
    """Simulate a recording: a calibration, 2D keypoints with detector errors, and the ground truth."""
    from posefuse.io.files import replacing_folder
    from posefuse.io.outputs import check_new_folder
    from posefuse.synthetic.scenes import simulate as run

    check_new_folder(output, overwrite=overwrite, marker=TRUTH)
    simulated = run(scene)
    with replacing_folder(output, marker=TRUTH, owned=(CALIBRATION, KEYPOINTS, TRUTH)) as staging:
        write_scene(simulated, staging)
    say(
        f"{simulated.detections.n_frames} frames at {scene.rate_hz:g} Hz, {len(simulated.rig)} cameras, "
        f"{len(simulated.detections.skeleton)} keypoints"
    )
    if simulated.offsets_s.any():
        offsets = ", ".join(
            f"{name} {1000 * s:+.1f}" for name, s in zip(simulated.rig.names, simulated.offsets_s, strict=True)
        )
        say(f"clock offsets in ms: {offsets}")
    wrote([CALIBRATION, KEYPOINTS, TRUTH], output)


def write_scene(scene: "Scene | CrowdScene", folder: Path) -> None:
    """Write the calibration, keypoints and ground truth of a scene."""
    from posefuse.io.calibration import anipose
    from posefuse.io.keypoints import native
    from posefuse.io.results import netcdf

    anipose.write(scene.rig, folder / CALIBRATION)
    native.write(scene.detections, folder / KEYPOINTS)
    netcdf.write([scene.truth], folder / TRUTH)
