"""``posefuse warm-up``."""

from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, say
from posefuse.errors import choices


def warm_up(*, jobs: Annotated[int, Parameter(help="Number of processes.")] = 2) -> None:
    """Compile and store the kernels, so that the first recording does not wait for them.

    Run it once in the image of a container or on each machine of a cluster, as the user who reconstructs.
    """
    from posefuse.diagnostics.installation import kernel_cache
    from posefuse.pipeline.warm_up import warm_up as run

    ready = run(jobs, progress=Bars())
    say(f"Kernels for {choices(ready)} are compiled and stored in {kernel_cache()}")
