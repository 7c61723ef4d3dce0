"""Whether what was seen can tell where cameras stand; where not, which of them and why."""

import numpy as np

from posefuse.calibration.sightings import Sightings
from posefuse.calibration.uncertainty import Certainty
from posefuse.errors import CalibrationError, choices
from posefuse.model.cameras import CameraRig

FEWEST_POINTS = 100
FEWEST_SHARED = 30
_COVERED = 1.0 / 3.0
_WORST_TURN_DEG = 2.0
_WORST_SHIFT_SHARE = 0.1
_WORST_FOCAL = 0.02
_WORTHLESS = 2.0
_UNFIT = 5.0
_UNFIT_SHARE = 0.02
_FEWEST_TO_TELL = 4
_SAME_PLACE_SHARE = 1e-3
_SAME_TURN_RAD = 1e-3


def strangers(sightings: Sightings, n_views: int) -> dict[int, int]:
    """Views that are not joined to most others by points they share: view to the points it shares with those."""
    seen = np.zeros((sightings.n_points, n_views))
    seen[sightings.point, sightings.view] = 1.0
    shared = seen.T @ seen
    joined = shared >= FEWEST_SHARED
    np.fill_diagonal(joined, True)
    for _ in range(n_views):
        joined = (joined.astype(int) @ joined.astype(int)) > 0
    sizes = joined @ np.diag(shared)
    home = joined[int(np.argmax(sizes * (joined.sum(axis=1) > 1)))]
    return {v: int(shared[v, home].max()) for v in range(n_views) if not home[v]}


def copy_of(rig: CameraRig, used: np.ndarray) -> tuple[int, int] | None:
    """Two cameras of one pose: the one that agrees less with the others, and the other; None where there are none.

    Args:
        rig: the cameras.
        used: shape (view,): share of its detections that agree with other views.
    """
    centres = np.array([camera.centre_m for camera in rig.cameras])
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
    close = _SAME_PLACE_SHARE * float(apart.max())
    for a in range(len(rig)):
        for b in range(a):
            turned = np.abs(rig.cameras[a].rotation - rig.cameras[b].rotation).max()
            if apart[a, b] <= close and turned < _SAME_TURN_RAD:
                return (a, b) if used[a] < used[b] else (b, a)
    return None


def worthless(before: CameraRig, sightings: Sightings, points_m: np.ndarray) -> dict[int, float]:
    """Cameras whose given pose tells less of what they see than no pose would: view to how far off it is, in px.

    What they see lies more than twice as far from where it should as from the middle of all that they see.

    Args:
        before: the cameras as they were given.
        sightings: what they saw.
        points_m: shape (point, 3), in the world of ``before``.
    """
    found = {}
    for v, camera in enumerate(before.cameras):
        mine = sightings.view == v
        if not mine.any():
            continue
        pixels = sightings.pixels[mine]
        seen, codes = camera.project(points_m[sightings.point[mine]])
        far = float(np.hypot(*camera.size_px))
        error = float(np.median(np.where(codes == 0, np.linalg.norm(seen - pixels, axis=1), far)))
        if error > _WORTHLESS * float(np.median(np.linalg.norm(pixels - np.median(pixels, axis=0), axis=1))):
            found[v] = min(error, far)
    return found


def unfit(rig: CameraRig, error_px: np.ndarray) -> dict[int, float]:
    """Views that fit the others far worse than these fit each other, adjusted as they are: view to the error in px.

    Among three nobody can tell who it is.
    """
    if len(rig) < _FEWEST_TO_TELL:
        return {}
    usual = float(np.nanmedian(error_px))
    side = np.array([max(camera.size_px) for camera in rig.cameras])
    bad = (error_px > _UNFIT * usual) & (error_px > _UNFIT_SHARE * side)
    return {int(v): float(error_px[v]) for v in np.flatnonzero(bad)}


def must_cover(rig: CameraRig, covered: np.ndarray, views: list[int]) -> None:
    """Refuse to change lenses that only a part of the image tells of.

    Raises:
        CalibrationError: naming the cameras.
    """
    narrow = [rig.names[v] for v in views if not covered[v]]
    if narrow:
        raise CalibrationError(
            f"Focal lengths and distortion cannot be told from these points: in the images of {choices(narrow)} they "
            f"cover less than a third of the width or of the height, and a nearer camera with a shorter lens would see "
            "them alike. Refine the extrinsics only, or use a board that was moved through the whole image (--from "
            "board)."
        )


def covers(rig: CameraRig, sightings: Sightings, view: int) -> bool:
    """Whether what a view saw spreads over a third of its image's width and height."""
    pixels = sightings.pixels[sightings.view == view]
    if not len(pixels):
        return False
    low, high = np.percentile(pixels, [2, 98], axis=0)
    return bool(np.all(high - low >= _COVERED * np.array(rig.cameras[view].size_px)))


def must_suffice(sightings: Sightings) -> None:
    """Refuse what is too little.

    Raises:
        CalibrationError: with how many points there are.
    """
    if sightings.n_points < FEWEST_POINTS:
        raise CalibrationError(
            f"Only {sightings.n_points} points are seen by two cameras that agree roughly where they are; at least "
            f"{FEWEST_POINTS} are needed to refine a calibration. Take more of the recording, or locate cameras that "
            "are far off from scratch (--relocate NAME)."
        )


def must_determine(certain: Certainty, rig: CameraRig, reach_m: float) -> None:
    """Refuse a result that the points do not determine.

    Args:
        certain: how well the cameras are known.
        rig: the refined cameras.
        reach_m: how far they are from what they see.

    Raises:
        CalibrationError: naming the cameras, and how badly they are known.
    """
    if certain.undetermined is not None:
        strongest = int(np.abs(certain.undetermined.reshape(len(rig), -1)).max(axis=1).argmax())
        raise CalibrationError(
            f"These points leave the cameras free to move together, {rig.names[strongest]!r} most of all, without any "
            "change of what they would see: the Schur complement is singular. Points in one plane or line, or too few "
            "views of each, do this. Fix two cameras that have not moved (--fix), or take more of the recording."
        )
    poor = [v for v in range(len(rig)) if not determined(certain, v, reach_m)]
    if poor:
        said = []
        for v in poor:
            turn_deg, shift_m, focal = spreads(certain.block(v))
            lens = f", focal length to {100 * focal:.2g} %" if focal > 0 else ""
            said.append(f"{rig.names[v]!r}: direction to {turn_deg:.2g} degrees, place to {100 * shift_m:.2g} cm{lens}")
        raise CalibrationError(
            f"These points do not tell where cameras stand well enough to change that. They would be known, one "
            f"standard deviation, for {'; '.join(said)}. Keep such cameras as they are (--fix), leave them out "
            "(--exclude-camera), refine less (--refine extrinsics), use a board (--from board), or take more of the "
            "recording: a subject that moves through the whole volume tells most."
        )


def determined(certain: Certainty, view: int, reach_m: float) -> bool:
    """Whether a camera is known to two degrees, a tenth of its distance, and 2 % of its focal length."""
    turn_deg, shift_m, focal = spreads(certain.block(view))
    return turn_deg <= _WORST_TURN_DEG and shift_m <= _WORST_SHIFT_SHARE * reach_m and focal <= _WORST_FOCAL


def spreads(block: np.ndarray) -> tuple[float, float, float]:
    """Standard deviations of a camera: direction in degrees, centre in m (each where worst), focal length in parts."""
    turn = np.sqrt(max(float(np.linalg.eigvalsh(block[0:3, 0:3])[-1]), 0.0))
    shift = np.sqrt(max(float(np.linalg.eigvalsh(block[3:6, 3:6])[-1]), 0.0))
    return float(np.degrees(turn)), float(shift), float(np.sqrt(max(block[6, 6], 0.0)))
