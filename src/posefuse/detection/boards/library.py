"""Import of OpenCV, the optional dependency for boards (extra ``calibrate``)."""

from typing import Any

from posefuse.errors import FileError


def import_opencv() -> Any:
    """Return the module ``cv2``.

    Raises:
        FileError: if it is not installed.
    """
    try:
        import cv2
    except ImportError:
        raise FileError("Boards need OpenCV, which is not installed. Run: pip install 'posefuse[calibrate]'.") from None
    # Boards are detected in parallel processes, one image each.
    cv2.setNumThreads(1)
    return cv2


def dictionary_of(name: str) -> Any:
    """Return OpenCV's dictionary of markers of a name such as ``4X4_50`` or ``APRILTAG_36h11``."""
    cv2 = import_opencv()
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
