"""``posefuse warm-up``."""

from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import Bars, say
from posefuse.errors import FileError, choices


def warm_up(*, jobs: Annotated[int, Parameter(help="Number of processes.")] = 2) -> None:
    """Compile and store the kernels, so that the first recording does not wait for them.

    Run it once in the image of a container or on each machine of a cluster. Wheels for some systems contain most
    kernels. Others are stored in NUMBA_CACHE_DIR, else beside the code, else in the cache of the user; users who cannot
    write to such a folder read what it holds.
    """
    from posefuse.diagnostics.installation import kernel_cache, prebuilt_kernels
    from posefuse.pipeline.warm_up import warm_up as run

    folder, is_writable = kernel_cache()
    has_own = not prebuilt_kernels()[1]
    if not is_writable and not has_own:
        where = f"{folder} is read-only" if folder else "no folder for them is writable"
        raise FileError(f"Kernels cannot be stored: {where}. Set NUMBA_CACHE_DIR to a writable folder.")
    ready = choices(run(jobs, progress=Bars()))
    if has_own:
        others = f"; others are stored in {folder}" if is_writable else ""
        say(f"Kernels for {ready} are ready. The package contains them{others}")
    else:
        say(f"Kernels for {ready} are compiled and stored in {folder}")
