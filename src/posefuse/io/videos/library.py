"""PyAV, which is needed only where videos are: the extra ``video``."""

from typing import Any

from posefuse.errors import FileError


def pyav() -> Any:
    """The library that reads and writes videos.

    Raises:
        FileError: if it is not installed.
    """
    try:
        import av
    except ImportError:
        raise FileError("Videos need PyAV, which is not installed: pip install 'posefuse[video]'.") from None
    return av
