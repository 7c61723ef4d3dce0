"""``posefuse simulate``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from posefuse.cli.console import say, wrote
from posefuse.synthetic.options import SceneOptions

if TYPE_CHECKING:
    from posefuse.synthetic.crowds import CrowdScene
    from posefuse.synthetic.scenes import Scene

CALIBRATION = "calibration.toml"
KEYPOINTS = "keypoints.nc"
TRUTH = "truth.nc"


def simulate(
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for the recording; made if absent.")],
    *,
    scene: Annotated[SceneOptions, Parameter(name="*", group="Scene")] = SceneOptions(),  # noqa: B008
) -> None:
    """Simulate a recording: a calibration, 2D keypoints with a detector's faults, and the truth beside them."""
    from posefuse.io.files import replacing_folder
    from posefuse.synthetic.scenes import simulate as run

    made = run(scene)
    with replacing_folder(output, marker=TRUTH, owned=(CALIBRATION, KEYPOINTS, TRUTH)) as staging:
        write_scene(made, staging)
    say(
        f"{made.detections.n_frames} frames at {scene.rate_hz:g} Hz, {len(made.rig)} cameras, "
        f"{len(made.detections.skeleton)} keypoints"
    )
    if made.offsets_s.any():
        offsets = ", ".join(f"{name} {1000 * s:+.1f}" for name, s in zip(made.rig.names, made.offsets_s, strict=True))
        say(f"clock offsets in ms: {offsets}")
    wrote([CALIBRATION, KEYPOINTS, TRUTH], output)


def write_scene(scene: "Scene | CrowdScene", folder: Path) -> None:
    """Write a scene's calibration, keypoints and truth."""
    from posefuse.io.calibration import anipose
    from posefuse.io.keypoints import native
    from posefuse.io.results import netcdf

    anipose.write(scene.rig, folder / CALIBRATION)
    native.write(scene.detections, folder / KEYPOINTS)
    netcdf.write([scene.truth], folder / TRUTH)
