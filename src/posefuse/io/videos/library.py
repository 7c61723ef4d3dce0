"""Import of PyAV, the optional dependency for videos (extra ``video``)."""

from typing import Any

from posefuse.errors import FileError


def import_pyav() -> Any:
    """Return the module ``av``, which reads and writes videos.

    Raises:
        FileError: if it is not installed.
    """
    try:
        import av
    except ImportError:
        raise FileError("Videos need PyAV, which is not installed. Run: pip install 'posefuse[video]'.") from None
    return av
