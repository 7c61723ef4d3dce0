"""``posefuse warm-up``."""

from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, say
from posefuse.errors import FileError, choices


def warm_up(*, jobs: Annotated[int, Parameter(help="Number of processes.")] = 2) -> None:
    """Compile and store the kernels, so that the first recording does not wait for them.

    Run it once in the image of a container or on each machine of a cluster. Kernels are stored in NUMBA_CACHE_DIR, else
    beside the code, else in the cache of the user; users who cannot write to such a folder read what it holds.
    """
    from posefuse.diagnostics.installation import kernel_cache
    from posefuse.pipeline.warm_up import warm_up as run

    folder, is_writable = kernel_cache()
    if not is_writable:
        where = f"{folder} is read-only" if folder else "no folder for them is writable"
        raise FileError(f"Kernels cannot be stored: {where}. Set NUMBA_CACHE_DIR to a writable folder.")
    ready = run(jobs, progress=Bars())
    say(f"Kernels for {choices(ready)} are compiled and stored in {folder}")
