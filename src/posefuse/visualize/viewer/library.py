"""rerun, which is needed only to view: the extra ``view``."""

from typing import Any

from posefuse.errors import ResultError


def rerun() -> Any:
    """The library of rerun's viewer.

    Raises:
        ResultError: if it is not installed.
    """
    try:
        import rerun as rr
    except ImportError:
        raise ResultError(
            "posefuse view needs rerun, which is not installed: pip install 'posefuse[view]'. Without it there is the "
            "page that posefuse report writes."
        ) from None
    return rr
