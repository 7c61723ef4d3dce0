"""``posefuse demo``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, say


def demo(
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for all files; created if absent.")] = Path(
        "demo"
    ),
    *,
    seed: Annotated[int, Parameter(help="Random seed of the simulated scene.")] = 0,
) -> None:
    """Simulate a person in front of five cameras, reconstruct, compare with the truth, and write a report."""
    from posefuse.cli.describe_result import describe_result
    from posefuse.cli.evaluate import evaluate
    from posefuse.cli.report import report
    from posefuse.cli.simulate import TRUTH, write_scene
    from posefuse.io.files import replacing_folder
    from posefuse.pipeline.reconstruct_recording import reconstruct_recording
    from posefuse.synthetic.options import SceneOptions
    from posefuse.synthetic.scenes import simulate

    recording, result = output / "recording", output / "result"
    say("Simulating a person who walks, turns, reaches, sits and jumps")
    with replacing_folder(recording, marker=TRUTH, owned=(TRUTH,)) as staging:
        write_scene(simulate(SceneOptions(seed=seed)), staging)
    say("Reconstructing")
    describe_result(reconstruct_recording(recording, result, progress=Bars()).open())
    evaluate(result, (recording / TRUTH,))
    report(result, truth=(recording / TRUTH,))
    say(f"The report: {(result / 'report.html').resolve().as_uri()}")
