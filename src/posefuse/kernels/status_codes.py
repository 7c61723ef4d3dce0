"""Status codes of points and views, as kernels write them.

:mod:`posefuse.model.status` gives them names and descriptions. A point whose code is below ``POINT_MISSING`` has
coordinates. From ``POINT_MISSING`` on, the coordinates are NaN and the code gives the reason.
"""

POINT_OK = 0
POINT_TWO_VIEWS = 1
POINT_WEAK_GEOMETRY = 2
POINT_AMBIGUOUS = 3
POINT_SINGLE_VIEW = 4
POINT_HELD = 5
POINT_FILLED = 6
POINT_MISSING = 16
POINT_NOT_SEEN = 16
POINT_TOO_FEW_VIEWS = 17
POINT_DEGENERATE = 18
POINT_BEHIND_CAMERA = 19
POINT_NO_CONVERGENCE = 20
POINT_OUTLIER = 21
POINT_ABSENT = 22
POINT_UNDECIDED = 23
POINT_NOT_FOLLOWED = 24
POINT_UNCERTAIN = 25

VIEW_USED = 0
VIEW_UNSEEN = 1
VIEW_LOW_CONFIDENCE = 2
VIEW_BEYOND_LENS = 3
VIEW_OUTLIER = 4
VIEW_BEHIND_CAMERA = 5
VIEW_NOT_RECORDED = 6
VIEW_NOT_USED = 7
VIEW_USED_SWAPPED = 8

NO_DETECTION = -1
"""Entry of a row table: the view has no detection of this person in this frame."""
NOT_RECORDED = -2
"""Entry of a row table: the view did not record this frame."""
