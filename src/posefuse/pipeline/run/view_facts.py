"""Facts on the images of the views, known before any of them is examined."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from posefuse.errors import PosefuseError, choices
from posefuse.io.board_images import ViewImages
from posefuse.io.videos.reader import open_video
from posefuse.model.cameras import CameraRig
from posefuse.model.view_names import matching_name

_SAME_LENGTH_S = 0.5
_MOST_CROPPED = 0.02
"""Largest share of its width or height that an image may lack to count as cropped."""


@dataclass(frozen=True)
class ViewFacts:
    """Facts on the images of one view.

    Attributes:
        name: name of the view.
        size_px: width and height for display.
        is_video: whether there is one video.
        rate_hz: mean frame rate, or None if unknown.
        duration_s: length of the video; NaN if unknown.
    """

    name: str
    size_px: tuple[int, int]
    is_video: bool
    rate_hz: float | None = None
    duration_s: float = math.nan


def examine_views(views: Sequence[ViewImages], problems: list[str]) -> tuple[ViewFacts, ...]:
    """Return the facts on all views; a view that cannot be read adds a problem."""
    found = []
    for view in views:
        try:
            info = open_video(view.files[0]).info
        except PosefuseError as error:
            problems.append(str(error))
            continue
        rate_hz = info.rate_hz if view.is_video else None
        duration_s = info.n_frames / rate_hz if info.n_frames and rate_hz else math.nan
        found.append(ViewFacts(view.name, info.size_px, view.is_video, rate_hz, duration_s))
    return tuple(found)


def describe_views(views: Sequence[ViewFacts]) -> str:
    """Return size, rate and length of the videos in a few words."""
    sizes = list(dict.fromkeys(f"{view.size_px[0]} x {view.size_px[1]}" for view in views))
    rates = sorted({round(view.rate_hz, 2) for view in views if view.rate_hz})
    lengths = [view.duration_s for view in views if not math.isnan(view.duration_s)]
    parts = [f"{choices(sizes, 3)} px"]
    if rates:
        parts.append(f"{choices([f'{rate:g}' for rate in rates], 3)} Hz")
    if lengths:
        low, high = min(lengths), max(lengths)
        parts.append(f"{low:.1f} s" if high - low < _SAME_LENGTH_S else f"{low:.1f} to {high:.1f} s")
    return ", ".join(parts)


def shortest_s(views: Sequence[ViewFacts]) -> float:
    """Return the length of the shortest video; infinite if none is known."""
    return min((view.duration_s for view in views if not math.isnan(view.duration_s)), default=math.inf)


def check_sizes(views: Sequence[ViewFacts], rig: CameraRig, notes: list[str], problems: list[str]) -> None:
    """Compare the sizes of images with those that their cameras were calibrated for.

    Args:
        views: facts on the views.
        rig: cameras of a calibration file.
        notes: receives differences that may be a crop.
        problems: receives differences that make the calibration wrong.
    """
    for view in views:
        name = matching_name(view.name, rig.names)
        if name is None:
            continue
        size, stated = view.size_px, rig[name].size_px
        if size == stated or min(stated) < 1:
            continue
        sizes = f"{size[0]} x {size[1]} px, but camera {name!r} was calibrated at {stated[0]} x {stated[1]} px"
        if _is_near(size, stated):
            edges = [edge for i, edge in enumerate(("right", "bottom")) if size[i] != stated[i]]
            where = " and ".join(edges)
            notes.append(f"The images of {view.name!r} have {sizes}. They count as cropped at the {where}.")
        elif _is_near(size, stated[::-1]):
            problems.append(
                f"The images of {view.name!r} have {sizes}: they are rotated by a quarter turn. Rotate the video, or "
                "calibrate again with `calibration='people'`."
            )
        else:
            problems.append(
                f"The images of {view.name!r} have {sizes}. Use a calibration of this resolution, or calibrate again "
                "with `calibration='people'`."
            )


def _is_near(size: tuple[int, ...], stated: tuple[int, ...]) -> bool:
    return all(abs(own - other) <= _MOST_CROPPED * other for own, other in zip(size, stated, strict=True))
