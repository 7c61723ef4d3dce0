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


def dictionary_of(name: str, n_markers: int | None = None) -> Any:
    """Return OpenCV's dictionary of markers.

    Args:
        name: name such as ``4X4_50`` or ``APRILTAG_36h11``.
        n_markers: number of markers, the first ones, that can occur; None for all. OpenCV compares every square shape
            with every marker, so a board is found several times faster among the few markers that it has.
    """
    cv2 = import_opencv()
    every = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
    if n_markers is None:
        return every
    return cv2.aruco.Dictionary(every.bytesList[:n_markers].copy(), every.markerSize, every.maxCorrectionBits)
