"""``posefuse demo``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, note, say
from posefuse.cli.types import Overwrite

_STAMP = "demo.txt"
"""File by which the folder of an earlier demo is recognized."""
_NOTE = "posefuse demo wrote the folders recording and result; the next demo in this folder replaces them.\n"


def demo(
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for all files; created if absent.")] = Path(
        "demo"
    ),
    *,
    seed: Annotated[int, Parameter(help="Random seed of the simulated scene.")] = 0,
    overwrite: Overwrite = False,
) -> None:
    """Simulate a person in front of five cameras, reconstruct, compare with the truth, and write a report.

    The folder of an earlier demo is replaced.
    """
    from posefuse.cli.describe_result import describe_gait, describe_result
    from posefuse.cli.evaluate import NumbersFile, evaluate
    from posefuse.cli.report import report
    from posefuse.cli.simulate import TRUTH, write_scene
    from posefuse.io.files import replacing, replacing_folder
    from posefuse.io.outputs import check_new_folder
    from posefuse.pipeline.reconstruct_recording import reconstruct_recording
    from posefuse.synthetic.options import CURRENT, SceneOptions
    from posefuse.synthetic.scenes import simulate

    recording, result = output / "recording", output / "result"
    check_new_folder(output, overwrite=overwrite or (output / _STAMP).is_file())
    with replacing(output / _STAMP) as temporary:
        temporary.write_text(_NOTE, "utf-8")
    say("Simulating a person who walks, turns, reaches, sits and jumps, and five cameras with a detector like RTMPose")
    note(
        f"Errors of the detector: 2.25 px per 1000 px of image width and axis at confidence 1, heavy tails, "
        f"{100 * CURRENT.outlier_share:g} % outliers, {100 * CURRENT.miss_share:g} % missed, "
        f"{100 * CURRENT.swap_share:g} % limbs with "
        "left and right exchanged: half of what was measured on OpenPose (posefuse simulate)."
    )
    with replacing_folder(recording, marker=TRUTH, owned=(TRUTH,)) as staging:
        write_scene(simulate(SceneOptions(seed=seed, detector=CURRENT)), staging)
    say("Reconstructing")
    outcome = reconstruct_recording(recording, result, overwrite=True, progress=Bars())
    describe_result(outcome.open())
    describe_gait(outcome.gait)
    evaluate(result, (recording / TRUTH,), numbers=NumbersFile(overwrite=True))
    report(result, truth=(recording / TRUTH,), name=output.resolve().name, overwrite=True)
    say(f"The report: {(result / 'report.html').resolve().as_uri()}")
