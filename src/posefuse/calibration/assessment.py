"""Assess a calibration: one verdict, its weaknesses, and what to film or change next."""

from collections.abc import Iterator
from itertools import chain

import numpy as np

from posefuse.calibration.residual_structure import COLUMNS, ROWS, residual_structure
from posefuse.model.calibration_summary import (
    Advice,
    Assessment,
    AssessmentLevel,
    CalibrationSummary,
    CalibrationTarget,
    LengthCheck,
)

_GOOD_SHARE, _USABLE_SHARE = 0.003, 0.02
"""Standard deviation in the middle of the volume, as a share of the distance of the cameras.

Detectors of keypoints err by about 3 px at a focal length of 1000 px, 0.3 %; a good calibration errs less.
"""
_GOOD_LENGTH, _USABLE_LENGTH = 0.005, 0.02
_MIN_SHARED = 10
_MIN_PATH_SHARE, _ENDS = 0.5, (0.95, 0.05)
"""Least path of a walking person in sizes of a body, and the quantiles of the places that it is measured between."""
_LARGE_ERROR = 1.5
_NOTICEABLE_SHARE = 0.0003
"""Errors below this share of the image's width (0.6 px of 1920) are not worth a remark."""
_SYSTEMATIC_SHARE = 0.5
_MIN_OFFSET_S = 0.005
_MOST_MISSING = 4
"""With more of the nine parts of an image missing, the parts that were seen are named."""
_FILMED: dict[CalibrationTarget, str] = {
    "board": "Film the board", "people": "Film a person", "points": "Measure more points",
}  # fmt: skip
_WHERE: dict[CalibrationTarget, str] = {
    "board": "in the middle of the volume, close to all cameras and tilted to all sides.",
    "people": "who walks through the whole volume, in several directions.",
    "points": "spread over the images and in depth, and measure their places in enlarged pictures.",
}
_CAUSES: dict[CalibrationTarget, str] = {
    "board": "Check its focus, motion blur, exposure and frame times.",
    "people": "Check its detections, focus and frame times.",
    "points": "",
}
_FEW_POINTS = 6
"""With fewer points, a camera's pose hardly shows that one of them is wrong."""
_FLAT = 0.1
"""Ratio of the smallest to the largest extent of points that are nearly in one plane."""
WRONG_SDS = 3.7
"""Mahalanobis distance that one of 1000 correct points exceeds."""
_ORDER: dict[AssessmentLevel, int] = {"bad": 0, "check": 1, "note": 2, "good": 3}


def assess(summary: CalibrationSummary) -> Assessment:
    """Return the verdict on a calibration, its weaknesses, and what to do about them."""
    checks = (
        _left_out, _volume, _motion, _lengths, _links, _points, _errors, _structure, _held_out, _regions, _offsets,
    )  # fmt: skip
    found = sorted(chain.from_iterable(check(summary) for check in checks), key=lambda each: _ORDER[each.level])
    levels = {each.level for each in found}
    accuracy = _accuracy(summary)
    if "bad" in levels:
        return Assessment("bad", "Do not use this calibration.", tuple(found))
    if "check" in levels:
        n = sum(each.level == "check" for each in found)
        return Assessment(
            "check", f"Usable, with {n} {'weakness' if n == 1 else 'weaknesses'}. {accuracy}", tuple(found)
        )
    return Assessment("good", accuracy, tuple(found))


def _accuracy(summary: CalibrationSummary) -> str:
    """Return what the covariance of the cameras means for triangulated points."""
    volume = summary.volume
    length_sd = float(np.hypot(volume.length_sd, summary.scale_sd))
    where = "Places among the points" if summary.target == "points" else "Points in the filmed volume"
    return (
        f"{where} are located to {_millimetres(volume.relative_sd_m)} relative to each other, and "
        f"lengths measured to {_percent(length_sd)} (standard deviations)."
    )


def _millimetres(value_m: float) -> str:
    return f"{1000 * value_m:.2g} mm" if value_m < 0.01 else f"{1000 * value_m:.0f} mm"


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"


def _filmed(summary: CalibrationSummary) -> str:
    """Return what to do with the target where cameras are weakly connected."""
    return _FILMED[summary.target]


def _left_out(summary: CalibrationSummary) -> Iterator[Advice]:
    for name, reason in summary.left_out:
        yield Advice("check", name, f"Camera {name!r} is not calibrated: {reason}", "")


def _volume(summary: CalibrationSummary) -> Iterator[Advice]:
    """Judge the accuracy in the filmed volume, and the positions of single cameras."""
    volume = summary.volume
    where = _WHERE[summary.target]
    share = volume.relative_sd_m / volume.distance_m
    if not np.isfinite(share):
        yield Advice("bad", "", "No two cameras see the same part of the filmed volume.", f"{_filmed(summary)} {where}")
    elif share > _GOOD_SHARE:
        level: AssessmentLevel = "bad" if share > _USABLE_SHARE else "check"
        places = "Places among the points" if summary.target == "points" else "Points in the filmed volume"
        text = f"{places} are located only to {_millimetres(volume.relative_sd_m)}."
        longer = "for longer " if summary.target == "board" else ""
        yield Advice(level, "", text, f"{_filmed(summary)} {longer}{where}")
    for name, camera in zip(summary.rig.names, summary.cameras, strict=True):
        if camera.center_sd_m > _USABLE_SHARE * volume.distance_m:
            text = f"The position of camera {name!r} is known only to {_millimetres(camera.center_sd_m)}."
            better = where if summary.target == "points" else "where it and other cameras see the same place."
            yield Advice("check", name, text, f"{_filmed(summary)} {better}")


def _motion(summary: CalibrationSummary) -> Iterator[Advice]:
    """Warn of people who stay in one place, whose errors are those of their detector and hardly average out.

    On simulated rigs, 95 % regions contain the truth in 84 to 92 % with people who walk, and in 30 to 45 % with people
    who stand.
    """
    if summary.target == "people" and _path_share(summary.points_m) < _MIN_PATH_SHARE:
        text = "People stay in one place, so the standard deviations may be several times too small."
        remedy = f"{_filmed(summary)} who walks through the whole volume, in several directions."
        yield Advice("check", "", text, remedy)


def _path_share(points_m: np.ndarray) -> float:
    """Return how far the center of a subject moves, in sizes of a body; that of the subject who moves most.

    Args:
        points_m: shape (pose, subject, point, 3), NaN where unknown.
    """
    best = 0.0
    for body in np.swapaxes(points_m, 0, 1):
        known = body[np.isfinite(body[..., 0]).sum(axis=1) > 2]
        if len(known):
            centers = np.nanmedian(known, axis=1)
            sizes = np.linalg.norm(np.nanmax(known, axis=1) - np.nanmin(known, axis=1), axis=1)
            moved = np.linalg.norm(np.subtract(*np.quantile(centers, _ENDS, axis=0)))
            best = max(best, float(moved / np.median(sizes)))
    return best


def _lengths(summary: CalibrationSummary) -> Iterator[Advice]:
    for each in summary.lengths:
        if abs(each.error) > _GOOD_LENGTH:
            level: AssessmentLevel = "bad" if abs(each.error) > _USABLE_LENGTH else "check"
            yield Advice(level, "", _length_text(each), "Measure the printed board, and keep it flat and stiff.")


def _length_text(each: LengthCheck) -> str:
    return f"The {each.name} are {100 * each.error:+.2g} % off."


def _links(summary: CalibrationSummary) -> Iterator[Advice]:
    """Name cameras that share few frames with every other one; points locate each camera on its own."""
    if summary.target == "points":
        return
    for v, name in enumerate(summary.rig.names):
        others = np.delete(summary.shared[v], v)
        if len(others) and others.max() < _MIN_SHARED:
            best = summary.rig.names[int(np.argmax(np.where(np.arange(len(summary.rig)) == v, -1, summary.shared[v])))]
            text = f"Camera {name!r} shares only {int(others.max())} frames with any other camera."
            yield Advice("check", name, text, f"{_filmed(summary)} where both it and camera {best!r} see it.")


def _points(summary: CalibrationSummary) -> Iterator[Advice]:
    """Name points that the other points of a camera contradict, and cameras with too few points to tell."""
    known = summary.known_points
    if known is None:
        return
    with np.errstate(invalid="ignore"):
        wrong = known.held_out_sds > WRONG_SDS
    for point in np.flatnonzero(wrong.any(axis=0)):
        views = np.flatnonzero(wrong[:, point])
        names = _listed([f"{summary.rig.names[v]!r} ({known.held_out_px[v, point]:.0f} px)" for v in views])
        several = len(views) > 1 and 2 * len(views) >= np.isfinite(known.held_out_sds[:, point]).sum()
        text = f"Point {point + 1} is not where the other points of its camera predict it, in {names}."
        place = "Measure its position again, and check the order of the points."
        yield Advice(
            "check", summary.rig.names[views[0]], text, place if several else "Measure its place in that image again."
        )
    extents = np.linalg.svd(known.points_m - known.points_m.mean(axis=0), compute_uv=False)
    if extents[-1] < _FLAT * extents[0]:
        text = "The points are nearly in one plane, so the stated accuracy holds near this plane only."
        yield Advice("note", "", text, "Measure points at other heights, too.")
    for name, shown in zip(summary.rig.names, np.isfinite(known.error_px).sum(axis=1), strict=True):
        if shown < _FEW_POINTS:
            text = f"Camera {name!r} shows only {shown} points, so a wrong one would hardly be noticed."
            yield Advice("note", name, text, f"Measure {_FEW_POINTS} or more in its image.")


def _errors(summary: CalibrationSummary) -> Iterator[Advice]:
    """Name cameras that fit worse than the others; of points, single ones are named."""
    if summary.target == "points":
        return
    errors = np.array(
        [camera.error_px / width for camera, width in zip(summary.cameras, _widths(summary), strict=True)]
    )
    typical = float(np.nanmedian(errors))
    for name, camera, error in zip(summary.rig.names, summary.cameras, errors, strict=True):
        if len(errors) > 2 and error > _LARGE_ERROR * typical and error > _NOTICEABLE_SHARE:
            text = f"Camera {name!r} fits worse than the others: root mean square error {camera.error_px:.2f} px."
            yield Advice("check", name, text, _CAUSES[summary.target])


def _widths(summary: CalibrationSummary) -> list[int]:
    return [camera.size_px[0] for camera in summary.rig.cameras]


def _structure(summary: CalibrationSummary) -> Iterator[Advice]:
    """Name cameras whose residuals depend on the place in the image; those of people do for other reasons, too."""
    if summary.target != "board":
        return
    for camera, each in zip(summary.rig.cameras, summary.cameras, strict=True):
        systematic = residual_structure(each, camera.size_px).systematic_px
        if systematic > max(_SYSTEMATIC_SHARE * each.error_px, _NOTICEABLE_SHARE * camera.size_px[0]):
            text = (
                f"The residuals of camera {camera.name!r} depend on the place in the image: {systematic:.2f} of "
                f"{each.error_px:.2f} px."
            )
            known = "Its given lens does not fit: estimate it from these images, or add `refine_intrinsics=True`."
            yield Advice("check", camera.name, text, known if each.lens_given else "Try another lens model (`lens`).")


def _held_out(summary: CalibrationSummary) -> Iterator[Advice]:
    """Name cameras that predict other images worse than those of the calibration."""
    if summary.target == "points":
        return
    for camera, each in zip(summary.rig.cameras, summary.cameras, strict=True):
        if each.held_out_px > _LARGE_ERROR * each.error_px and each.held_out_px > _NOTICEABLE_SHARE * camera.size_px[0]:
            text = (
                f"Camera {camera.name!r} predicts images that it was not calibrated with only to "
                f"{each.held_out_px:.2f} px, instead of {each.error_px:.2f} px."
            )
            yield Advice("check", camera.name, text, f"{_filmed(summary)} in more images of this camera.")


def _regions(summary: CalibrationSummary) -> Iterator[Advice]:
    """Name the parts of images in which the board was never seen, where the lens was estimated from the board."""
    if summary.target != "board":
        return
    for camera, each in zip(summary.rig.cameras, summary.cameras, strict=True):
        parts = {} if each.lens_given else _regions_seen(each.counts(camera.size_px, COLUMNS, ROWS) > 0)
        missing = [name for name, is_seen in parts.items() if not is_seen]
        if len(missing) > _MOST_MISSING:
            seen = [name for name, is_seen in parts.items() if is_seen]
            text = f"Camera {camera.name!r} shows the board only in the {_listed(seen)} of its image."
            yield Advice("check", camera.name, text, "Film it in the other parts.")
        elif missing:
            text = f"No board in the {_listed(missing)} of camera {camera.name!r}."
            yield Advice("note", camera.name, text, "Film it there.")


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _regions_seen(covered: np.ndarray) -> dict[str, bool]:
    """Return whether each ninth of an image has a detected point; ``covered`` has shape (rows, columns), bool."""
    rows, columns = covered.shape
    return {
        f"{high} {side}": bool(
            covered[r * rows // 3 : (r + 1) * rows // 3, c * columns // 3 : (c + 1) * columns // 3].any()
        )
        for r, high in enumerate(("upper", "middle", "lower"))
        for c, side in enumerate(("left", "center", "right"))
    }


def _offsets(summary: CalibrationSummary) -> Iterator[Advice]:
    """Name cameras whose images are early or late; calibration files cannot hold that."""
    first, *names = summary.rig.names
    found = [
        f"{name!r} {1000 * each.offset_s:+.0f} ms"
        for name, each in zip(names, summary.cameras[1:], strict=True)
        if abs(each.offset_s) > max(3.0 * each.offset_sd_s, _MIN_OFFSET_S)
    ]
    if found:
        text = f"The images were not synchronized. Relative to camera {first!r}, {_listed(found)} (positive is later)."
        yield Advice("note", "", text, "If recordings are not synchronized either, use posefuse sync.")
