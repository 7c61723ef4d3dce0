"""``posefuse simulate-people``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import say, wrote
from posefuse.cli.simulate import CALIBRATION, KEYPOINTS, TRUTH, write_scene
from posefuse.synthetic.crowd_options import CrowdOptions


def simulate_people(
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for the recording; made if absent.")],
    *,
    scene: Annotated[CrowdOptions, Parameter(name="*", group="Scene")] = CrowdOptions(),  # noqa: B008
) -> None:
    """Simulate a recording of several people: a calibration, what a detector makes of them, and the truth."""
    from posefuse.io.files import replacing_folder
    from posefuse.synthetic.crowds import simulate_crowd

    made = simulate_crowd(scene)
    with replacing_folder(output, marker=TRUTH, owned=(CALIBRATION, KEYPOINTS, TRUTH)) as staging:
        write_scene(made, staging)
    found = made.detections
    say(
        f"{scene.scenario}: {scene.n_people} people, {found.n_frames} frames at {scene.rate_hz:g} Hz, "
        f"{len(made.rig)} cameras, {int(found.people_counts.sum())} detections"
    )
    for span in made.spans:
        whom = "" if span.person is None else f" {made.truth.person_ids[span.person]}"
        where = "" if span.view is None else f" {made.rig.names[span.view]}"
        until = f"to {span.to_s:.1f} s" if span.to_s < scene.length_s else "to the end"
        say(f"{span.what}{whom}{where}: from {span.from_s:.1f} s {until}")
    wrote([CALIBRATION, KEYPOINTS, TRUTH], output)
