"""``posefuse simulate-people``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import say, wrote
from posefuse.cli.simulate import CALIBRATION, KEYPOINTS, TRUTH, write_scene
from posefuse.cli.types import Overwrite
from posefuse.synthetic.crowd_options import CrowdOptions


def simulate_people(
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for the recording.")],
    *,
    overwrite: Overwrite = False,
    scene: Annotated[CrowdOptions, Parameter(name="*", group="Scene")] = CrowdOptions(),  # noqa: B008
) -> None:
    """Simulate a recording of several people: a calibration, 2D keypoints, and the ground truth."""
    from posefuse.io.files import replacing_folder
    from posefuse.io.outputs import check_new_folder
    from posefuse.synthetic.crowds import simulate_crowd

    check_new_folder(output, overwrite=overwrite, marker=TRUTH)
    simulated = simulate_crowd(scene)
    with replacing_folder(output, marker=TRUTH, owned=(CALIBRATION, KEYPOINTS, TRUTH)) as staging:
        write_scene(simulated, staging)
    detections = simulated.detections
    say(
        f"{scene.scenario}: {scene.n_people} people, {detections.n_frames} frames at {scene.rate_hz:g} Hz, "
        f"{len(simulated.rig)} cameras, {int(detections.people_counts.sum())} detections"
    )
    for span in simulated.spans:
        person = "" if span.person is None else f" {simulated.truth.person_ids[span.person]}"
        view = "" if span.view is None else f" {simulated.rig.names[span.view]}"
        until = f"to {span.to_s:.1f} s" if span.to_s < scene.length_s else "to the end"
        say(f"{span.what}{person}{view}: from {span.from_s:.1f} s {until}")
    wrote([CALIBRATION, KEYPOINTS, TRUTH], output)
