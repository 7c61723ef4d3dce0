"""``posefuse demo``."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import say


def demo(
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for everything; made if absent.")] = Path(
        "demo"
    ),
    *,
    seed: Annotated[int, Parameter(help="Of the simulated scene.")] = 0,
) -> None:
    """Simulate a person before five cameras, reconstruct, compare with the truth, and write a report."""
    from posefuse.cli.evaluate import evaluate
    from posefuse.cli.reconstruct import reconstruct_into
    from posefuse.cli.report import report
    from posefuse.cli.simulate import TRUTH, write_scene
    from posefuse.io.files import replacing_folder
    from posefuse.model.options.options import Options
    from posefuse.synthetic.options import SceneOptions
    from posefuse.synthetic.scenes import simulate

    recording, result = output / "recording", output / "result"
    say("Simulating a person who walks, turns, reaches, sits and jumps")
    with replacing_folder(recording, marker=TRUTH, owned=(TRUTH,)) as staging:
        write_scene(simulate(SceneOptions(seed=seed)), staging)
    say("Reconstructing")
    with replacing_folder(result) as staging:
        reconstruct_into(staging, recording, None, None, Options())
    evaluate(result, (recording / TRUTH,))
    report(result, truth=recording / TRUTH)
    say(f"The report: {(result / 'report.html').resolve().as_uri()}")
