"""What people must do, and cameras must film, for a calibration from people; each error says what to film."""

import warnings
from collections.abc import Sequence

import numpy as np

from posefuse.calibration.people.assemble import Assembly, Edges
from posefuse.calibration.people.bearings import NOISE_SHARE, Bearings
from posefuse.calibration.people.pairs import MIN_PARALLAX, PairGeometry, relate_pair
from posefuse.errors import CalibrationError, choices

MIN_FRAMES = 5
_MIN_MOTION = 0.03
_MIN_EXTENT_DEG = 4.0
_MAX_REST_COST = 0.8
_BLOCK_S, _MAX_BLOCKS = 0.5, 20


def check_filmed_enough(views: Sequence[Bearings], table: Sequence[Sequence[int]]) -> dict[str, str]:
    """Return the name and reason of each view with too few detections.

    Raises:
        CalibrationError: if fewer than two views are left, perspective is too weak, or no person moves.
    """
    left_out: dict[str, str] = {}
    for v, view in enumerate(views):
        people = [person[v] for person in table if person[v] >= 0]
        n = int(np.isfinite(view.sigma[:, people]).any(axis=(1, 2)).sum()) if people else 0
        if n < MIN_FRAMES:
            left_out[view.name] = f"It has a person in {n} frames; at least {MIN_FRAMES} are needed."
    if len(views) - len(left_out) < 2:
        raise CalibrationError(
            f"A person is detected in at least {MIN_FRAMES} frames by {len(views) - len(left_out)} of the "
            f"{len(views)} cameras; two are needed. Film a person who walks where all cameras see them."
        )
    check_perspective([view for view in views if view.name not in left_out])
    motions = [motion(view, table, v) for v, view in enumerate(views) if view.name not in left_out]
    if max(motions) < _MIN_MOTION:
        raise CalibrationError(
            "The people stand still: their keypoints move by less than "
            f"{_MIN_MOTION:.0%} of their height. Film a person who walks through the whole volume and turns around."
        )
    return left_out


def check_perspective(views: Sequence[Bearings]) -> None:
    """Check that the images depend on distances.

    Raises:
        CalibrationError: if all that most views observe lies in so small an angle that their projection is affine,
            which leaves signs and some angles of relative rotations undetermined (Hartley and Zisserman 2004, section
            14.4).
    """
    extents_deg = {view.name: _extent_deg(view) for view in views}
    narrow = {name: extent for name, extent in extents_deg.items() if extent < _MIN_EXTENT_DEG}
    if len(views) - len(narrow) < 2:
        shown = ", ".join(f"{name} ({extent:.2g} degrees)" for name, extent in narrow.items())
        raise CalibrationError(
            f"Cameras see all detections within {_MIN_EXTENT_DEG:g} degrees: {shown}. Perspective is too weak to "
            "determine their poses from what they film. Calibrate them with a board, film from closer, or film "
            "subjects who move through the whole images."
        )


def _extent_deg(view: Bearings) -> float:
    """Return the angle that contains nine tenths of the detected keypoints."""
    rays = view.rays[np.isfinite(view.rays[..., 0])]
    if not len(rays):
        return 0.0
    mean = rays.mean(axis=0)
    mean /= np.linalg.norm(mean)
    return float(
        2.0 * np.degrees(np.percentile(np.arctan2(np.linalg.norm(np.cross(rays, mean), axis=1), rays @ mean), 90.0))
    )


def motion(view: Bearings, table: Sequence[Sequence[int]], v: int) -> float:
    """Return how far keypoints of a view spread over time and people, relative to the size of a person."""
    people = [person[v] for person in table if person[v] >= 0]
    span_s = float(np.ptp(view.time_s))
    # Medians over blocks of time: a detector's errors change from frame to frame, but not motion.
    block = ((view.time_s - view.time_s[0]) / max(_BLOCK_S, span_s / _MAX_BLOCKS) + 1e-6).astype(np.int64)
    rays = view.rays[:, people]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        medians = np.stack([np.nanmedian(rays[block == k], axis=0) for k in np.unique(block)])
    medians = medians.reshape(-1, len(view.keypoints), 3)
    seen = np.isfinite(medians[..., 0]).sum(axis=0) >= 2
    if not seen.any():
        return 0.0
    low, high = np.nanpercentile(medians[:, seen], [10.0, 90.0], axis=0)
    size = float(np.nanmedian(view.sigma[:, people])) / NOISE_SHARE
    return float(np.median(np.linalg.norm(high - low, axis=-1))) / size


def has_parallax(edges: Edges) -> bool:
    """Return whether two related views see the people from different places, or no views are related."""
    related = [geometries[0] for geometries in edges.values() if geometries]
    return not related or max(geometry.parallax for geometry in related) >= MIN_PARALLAX


def check_parallax(names: Sequence[str], edges: Edges) -> None:
    """Check that cameras are at different places.

    Args:
        names: of all views.
        edges: geometries of pairs of views.

    Raises:
        CalibrationError: if no two related cameras see the people from different places.
    """
    if not has_parallax(edges):
        related = [pair for pair, geometries in edges.items() if geometries]
        shown = choices(names[v] for v in sorted({v for pair in related for v in pair}))
        raise CalibrationError(
            f"The cameras {shown} see the people from the same place, or from too far away: a rotation alone explains "
            "their images, and no distance can be determined. Move the cameras apart, or film people who are closer."
        )


def no_agreement(names: Sequence[str], max_offset_s: float) -> str:
    """Return the message about views that have no motion in common."""
    return (
        f"The motion in the views of {', '.join(names)} does not agree: people move less than the errors of their "
        "detections, or the cameras film different people or times. Film one person who walks through the images of "
        f"all cameras, turns around and raises an arm; clocks may differ by up to {max_offset_s:g} s (`max_offset_s`)."
    )


def related_rest(
    views: Sequence[Bearings], table: Sequence[Sequence[int]], assembly: Assembly, seed: int
) -> tuple[int, ...]:
    """Return the views outside an assembly that agree with each other."""
    rest = sorted(assembly.rejected)
    related: set[int] = set()
    for i, b in enumerate(rest):
        for a in rest[:i]:
            shared = tuple((p[a], p[b]) for p in table if p[a] >= 0 and p[b] >= 0)
            found: list[PairGeometry] = relate_pair(views[a], views[b], shared, seed=seed) if shared else []
            if found and found[0].cost < _MAX_REST_COST:
                related |= {a, b}
    return tuple(sorted(related))


def groups_error(views: Sequence[Bearings], first: Sequence[int], second: Sequence[int]) -> str:
    """Return the message about two groups of cameras that have no relation."""
    largest_first = sorted((first, second), key=lambda group: -len(group))
    groups = " and ".join(f"({choices(views[v].name for v in group)})" for group in largest_first)
    return (
        f"The cameras form two groups that film nothing in common: {groups}. Film a person who walks through the "
        "images of cameras of both groups at the same time, or calibrate each group by itself."
    )
