"""Import of rerun, the optional dependency of the viewer (extra ``view``)."""

from typing import Any

from posefuse.errors import ResultError


def import_rerun() -> Any:
    """Return the module ``rerun``.

    Raises:
        ResultError: if it is not installed.
    """
    try:
        import rerun as rr
    except ImportError:
        raise ResultError(
            "posefuse view needs rerun, which is not installed. Run: pip install 'posefuse[view]'. Or use posefuse "
            "report, which writes an HTML page."
        ) from None
    return rr
