"""Statuses of points and views, with names and sentences."""

from enum import IntEnum

import numpy as np

from posefuse.kernels import status_codes


class PointStatus(IntEnum):
    """Why a point has coordinates, or why it has none."""

    OK = status_codes.POINT_OK
    TWO_VIEWS = status_codes.POINT_TWO_VIEWS
    WEAK_GEOMETRY = status_codes.POINT_WEAK_GEOMETRY
    AMBIGUOUS = status_codes.POINT_AMBIGUOUS
    SINGLE_VIEW = status_codes.POINT_SINGLE_VIEW
    HELD = status_codes.POINT_HELD
    FILLED = status_codes.POINT_FILLED
    NOT_SEEN = status_codes.POINT_NOT_SEEN
    TOO_FEW_VIEWS = status_codes.POINT_TOO_FEW_VIEWS
    DEGENERATE = status_codes.POINT_DEGENERATE
    BEHIND_CAMERA = status_codes.POINT_BEHIND_CAMERA
    NO_CONVERGENCE = status_codes.POINT_NO_CONVERGENCE
    OUTLIER = status_codes.POINT_OUTLIER
    ABSENT = status_codes.POINT_ABSENT
    UNDECIDED = status_codes.POINT_UNDECIDED
    NOT_FOLLOWED = status_codes.POINT_NOT_FOLLOWED
    UNCERTAIN = status_codes.POINT_UNCERTAIN

    @property
    def label(self) -> str:
        """Name of the status in files."""
        return self.name.lower()

    @property
    def has_point(self) -> bool:
        """Whether the point has coordinates."""
        return self < status_codes.POINT_MISSING

    @property
    def sentence(self) -> str:
        """Meaning in a phrase."""
        return _POINT_SENTENCES[self]


class ViewStatus(IntEnum):
    """The contribution of a view to a point, or why it has none."""

    USED = status_codes.VIEW_USED
    UNSEEN = status_codes.VIEW_UNSEEN
    LOW_CONFIDENCE = status_codes.VIEW_LOW_CONFIDENCE
    BEYOND_LENS = status_codes.VIEW_BEYOND_LENS
    OUTLIER = status_codes.VIEW_OUTLIER
    BEHIND_CAMERA = status_codes.VIEW_BEHIND_CAMERA
    NOT_RECORDED = status_codes.VIEW_NOT_RECORDED
    NOT_USED = status_codes.VIEW_NOT_USED
    USED_SWAPPED = status_codes.VIEW_USED_SWAPPED

    @property
    def label(self) -> str:
        """Name of the status in files."""
        return self.name.lower()

    @property
    def sentence(self) -> str:
        """Meaning in a phrase."""
        return _VIEW_SENTENCES[self]


class Source(IntEnum):
    """How the coordinates of a point were computed."""

    NONE = 0
    MEASURED = 1
    FILLED = 2
    SMOOTHED = 3
    TRAJECTORY = 4
    MODELED = 5
    TRUTH = 6

    @property
    def label(self) -> str:
        """Name of the source in files; empty for a missing point."""
        return "" if self is Source.NONE else self.name.lower()

    @property
    def sentence(self) -> str:
        """Meaning in a phrase."""
        return _SOURCE_SENTENCES[self]


USED_CODES = (ViewStatus.USED, ViewStatus.USED_SWAPPED)


def is_used(view_status: np.ndarray) -> np.ndarray:
    """Return where a point uses the view, with its own label or that of the other side."""
    codes = np.asarray(view_status)
    return (codes == ViewStatus.USED) | (codes == ViewStatus.USED_SWAPPED)


def status_of_views(n_views: np.ndarray) -> np.ndarray:
    """Return the status, int8, of points that rest on a number of views in their frame and on other frames or bones."""
    by_number = [PointStatus.FILLED, PointStatus.HELD, PointStatus.TWO_VIEWS, PointStatus.OK]
    return np.array(by_number, dtype=np.int8)[np.minimum(n_views, 3)]


_POINT_SENTENCES = {
    PointStatus.OK: "measured from at least three views",
    PointStatus.TWO_VIEWS: "measured from two views, without a third view to check them",
    PointStatus.WEAK_GEOMETRY: "measured, but the rays are nearly parallel and the depth is uncertain",
    PointStatus.AMBIGUOUS: "two solutions explain the views about equally well; this is the better one",
    PointStatus.SINGLE_VIEW: "from one camera, in its image plane: not a position in the world",
    PointStatus.HELD: "seen by one camera; neighboring frames and bone lengths determine the depth",
    PointStatus.FILLED: "not measured; filled from neighboring frames or bone lengths",
    PointStatus.NOT_SEEN: "no valid detection",
    PointStatus.TOO_FEW_VIEWS: "fewer valid views than min_views",
    PointStatus.DEGENERATE: "the rays do not determine a point",
    PointStatus.BEHIND_CAMERA: "the rays meet behind a camera",
    PointStatus.NO_CONVERGENCE: "the refinement did not converge",
    PointStatus.OUTLIER: "the views contradict each other",
    PointStatus.ABSENT: "the person is absent",
    PointStatus.UNDECIDED: "two distant positions explain the views equally well",
    PointStatus.NOT_FOLLOWED: "part of a hand or face that is not tracked, or of no body",
    PointStatus.UNCERTAIN: "too uncertain to be reported",
}

_SOURCE_SENTENCES = {
    Source.NONE: "missing",
    Source.MEASURED: "from the views of the frame",
    Source.FILLED: "not measured; filled from neighboring frames",
    Source.SMOOTHED: "measured, then moved by a filter or onto a rigid bone",
    Source.TRAJECTORY: "from the views of all frames together",
    Source.MODELED: "from the fitted body model",
    Source.TRUTH: "ground truth",
}

_VIEW_SENTENCES = {
    ViewStatus.USED: "used",
    ViewStatus.UNSEEN: "not detected in this view",
    ViewStatus.LOW_CONFIDENCE: "detected, but below min_confidence",
    ViewStatus.BEYOND_LENS: "outside the part of the image the lens model describes",
    ViewStatus.OUTLIER: "contradicts the other views",
    ViewStatus.BEHIND_CAMERA: "the point would be behind this camera",
    ViewStatus.NOT_RECORDED: "the view has no such frame",
    ViewStatus.NOT_USED: "valid, but the point was not solved",
    ViewStatus.USED_SWAPPED: "used with left and right swapped",
}
