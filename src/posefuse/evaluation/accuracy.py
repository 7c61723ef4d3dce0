"""Errors of 3D points against ground truth.

MPJPE is the mean distance over all points that are in both the result and the truth, without alignment. The fraction of
missing points is reported separately.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posefuse.arguments import checked
from posefuse.errors import ResultError, choices
from posefuse.evaluation.consistency import consistency, normalized_squares
from posefuse.evaluation.other_world import OtherWorld, find_other_world
from posefuse.model.reconstruction import Layer, Reconstruction, unpack_covariance
from posefuse.model.status import is_used

FAR_M = 0.05
_SAME_TIME = 1e-3


@dataclass(frozen=True)
class Truth:
    """Ground truth of one person, on the frames of a result.

    Attributes:
        keypoints: names in the result's skeleton.
        points_m: shape (frame, keypoint, 3), in the result's world, NaN if unknown.
        matched_by: how frames were matched.
    """

    keypoints: tuple[str, ...]
    points_m: np.ndarray
    matched_by: str


@dataclass(frozen=True)
class Accuracy:
    """Distances to the ground truth, in mm, over all common points.

    Attributes:
        layer: compared layer.
        matched_by: how frames were matched.
        n_frames: number of frames with a comparison.
        n_keypoints: number of compared keypoints.
        n_points: number of compared points.
        mpjpe_mm: mean distance.
        median_mm: median distance.
        p90_mm: 90th percentile.
        p95_mm: 95th percentile.
        p99_mm: 99th percentile.
        share_beyond_50_mm: fraction of compared points beyond 50 mm.
        missing_share: fraction of the truth's points that the result lacks.
        reprojection_median_px: median reprojection error of all used observations.
        bone_variation: median over bones of the robust relative spread of their length over time.
        covered_68: fraction of compared points inside the 68 % region of their covariance; None without covariances.
        covered_95: fraction inside the 95 % region.
        median_mm_of: keypoint to its median distance.
        missing_share_of: keypoint to its missing fraction.
        other_world: the similarity that maps the result to the truth, if it removes nearly all of the distance.
    """

    layer: str
    matched_by: str
    n_frames: int
    n_keypoints: int
    n_points: int
    mpjpe_mm: float
    median_mm: float
    p90_mm: float
    p95_mm: float
    p99_mm: float
    share_beyond_50_mm: float
    missing_share: float
    reprojection_median_px: float | None
    bone_variation: float | None
    covered_68: float | None
    covered_95: float | None
    median_mm_of: Mapping[str, float]
    missing_share_of: Mapping[str, float]
    other_world: OtherWorld | None = None


@checked
def evaluate(result: Reconstruction, truth: Truth) -> Accuracy:
    """Compare one person of a result with ground truth.

    Args:
        result: reconstruction of one person; ``options.layer`` or the best layer is compared.
        truth: ground truth on the same frames.

    Raises:
        ResultError: if the result has several people, frames do not match, or there is no common point.
    """
    if result.unit != "m":
        raise ResultError(f"The result is in {result.unit} (one camera's image plane) and cannot be compared in 3D.")
    if len(result.person_ids) != 1:
        raise ResultError(
            f"The result has {len(result.person_ids)} people, but evaluate compares one. Use posefuse.score_people "
            "for several."
        )
    name, layer = result.best_layer(result.options.layer)
    if truth.points_m.shape[0] != result.n_frames:
        raise ResultError(f"The truth has {truth.points_m.shape[0]} frames, but the result has {result.n_frames}.")
    columns = [result.skeleton.index(keypoint) for keypoint in truth.keypoints]
    points = np.asarray(layer.points_m[:])[:, 0, columns]
    offsets = points - truth.points_m
    known = np.asarray(np.isfinite(truth.points_m).all(axis=-1))
    distance_mm = 1000.0 * np.linalg.norm(offsets, axis=-1)
    both = known & np.isfinite(distance_mm)
    if not both.any():
        raise ResultError("The result and the truth have no common point. Check that they are from the same recording.")
    flat = distance_mm[both]
    covered = _coverage(offsets[both], np.asarray(layer.covariance_m2[:])[:, 0, columns][both])
    missing = known & ~both
    return Accuracy(
        layer=name,
        matched_by=truth.matched_by,
        n_frames=int(both.any(axis=1).sum()),
        n_keypoints=int(both.any(axis=0).sum()),
        n_points=int(both.sum()),
        mpjpe_mm=float(flat.mean()),
        median_mm=float(np.median(flat)),
        p90_mm=float(np.percentile(flat, 90)),
        p95_mm=float(np.percentile(flat, 95)),
        p99_mm=float(np.percentile(flat, 99)),
        share_beyond_50_mm=float((flat > 1000.0 * FAR_M).mean()),
        missing_share=float(missing.sum() / known.sum()),
        reprojection_median_px=median_reprojection_px(layer),
        bone_variation=bone_variation(np.asarray(layer.points_m[:])[:, 0], result.skeleton.edge_indices),
        covered_68=covered[0],
        covered_95=covered[1],
        median_mm_of={
            keypoint: float(np.median(distance_mm[both[:, k], k]))
            for k, keypoint in enumerate(truth.keypoints)
            if both[:, k].any()
        },
        missing_share_of={
            keypoint: float(missing[:, k].sum() / max(known[:, k].sum(), 1))
            for k, keypoint in enumerate(truth.keypoints)
        },
        other_world=find_other_world(points[both], truth.points_m[both]),
    )


def median_reprojection_px(layer: Layer) -> float | None:
    """Return the median reprojection error of all used observations in px, None without any."""
    used = np.asarray(layer.view_error_px[:])[is_used(np.asarray(layer.view_status[:]))]
    used = used[np.isfinite(used)]
    return float(np.median(used)) if used.size else None


def bone_variation(points_m: np.ndarray, edges: np.ndarray) -> float | None:
    """Return the median over bones of 1.48 times the median absolute deviation over the median length.

    Args:
        points_m: shape (frame, keypoint, 3).
        edges: shape (edge, 2).

    Returns:
        A fraction, or None if no bone is seen twice.
    """
    shares = []
    for a, b in edges:
        lengths = np.linalg.norm(points_m[:, a] - points_m[:, b], axis=-1)
        lengths = lengths[np.isfinite(lengths)]
        if len(lengths) > 1 and np.median(lengths) > 0:
            middle = np.median(lengths)
            shares.append(1.4826 * np.median(np.abs(lengths - middle)) / middle)
    return float(np.median(shares)) if shares else None


def truth_from_result(result: Reconstruction, truth: Reconstruction) -> Truth:
    """Return ground truth from another reconstruction, such as a simulation, matched by frame number.

    Raises:
        ResultError: if they share no frame or no keypoint.
    """
    shared = tuple(name for name in truth.skeleton.keypoints if name in result.skeleton.keypoints)
    if not shared:
        raise ResultError(f"Result ({result.skeleton.name}) and truth ({truth.skeleton.name}) share no keypoint names.")
    if len(truth.person_ids) != 1:
        raise ResultError(
            f"The truth has {len(truth.person_ids)} people, but this function compares one. Use "
            "posefuse.people_points for several."
        )
    _, layer = truth.best_layer()
    columns = [truth.skeleton.index(name) for name in shared]
    if result.rate_hz and truth.rate_hz and abs(result.rate_hz / truth.rate_hz - 1.0) > 1e-3:
        points = np.asarray(layer.points_m[:])[:, 0][:, columns]
        return Truth(shared, interpolated(points, truth.time_s, result.time_s), "time")
    places = {int(number): i for i, number in enumerate(truth.frame_numbers)}
    rows = np.array([places.get(int(number), -1) for number in result.frame_numbers])
    if not (rows >= 0).any():
        raise ResultError("Result and truth share no frame number. Check that they are from the same recording.")
    points = np.asarray(layer.points_m[:])[:, 0][:, columns][np.maximum(rows, 0)].copy()
    points[rows < 0] = np.nan
    return Truth(shared, points, "frame number")


def truth_from_trajectories(
    result: Reconstruction, names: tuple[str, ...], time_s: np.ndarray, points_m: np.ndarray
) -> Truth:
    """Return ground truth from named trajectories in the result's world.

    Names may be canonical or those of another program; the first name of a keypoint is used. Frames are matched by
    order if the numbers are equal, otherwise by time with linear interpolation of the truth.

    Raises:
        ResultError: if no name is known, or no time matches.
    """
    places: dict[str, int] = {}
    for i, name in enumerate(names):
        keypoint = result.skeleton.canonical(name)
        if keypoint is not None:
            places.setdefault(keypoint, i)
    found = [(i, name) for name, i in places.items()]
    if not found:
        raise ResultError(f"The truth's points ({choices(names)}) do not occur in skeleton {result.skeleton.name}.")
    points = np.asarray(points_m)[:, [i for i, _ in found]]
    keypoints = tuple(name for _, name in found)
    if len(points) == result.n_frames:
        return Truth(keypoints, points, "order")
    if not np.isfinite(result.time_s).any():
        raise ResultError(
            f"The result has {result.n_frames} frames without times and the truth has {len(points)}, so they cannot be "
            "matched. Reconstruct with the frame rate (`rate_hz`), or cut the truth to the same frames."
        )
    if len(time_s) < 2 or not np.all(np.diff(time_s) > 0):
        raise ResultError(f"The truth needs at least two increasing times, got {len(time_s)}.")
    matched = interpolated(points, time_s, result.time_s)
    if not np.isfinite(matched).any():
        raise ResultError(
            f"No frame of the result ({np.nanmin(result.time_s):.3f} to {np.nanmax(result.time_s):.3f} s) is within "
            f"the truth's times ({time_s[0]:.3f} s to {time_s[-1]:.3f} s). Check that they are from the same recording."
        )
    return Truth(keypoints, matched, "time")


def interpolated(points_m: np.ndarray, time_s: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """Interpolate positions linearly; NaN outside, across gaps between frames, and next to missing points.

    Args:
        points_m: shape (frame, keypoint, 3).
        time_s: shape (frame,), increasing.
        at_s: shape (other frame,), NaN if unknown.

    Returns:
        Shape (other frame, keypoint, 3).
    """
    period = float(np.median(np.diff(time_s)))
    after = np.clip(np.searchsorted(time_s, at_s), 1, len(time_s) - 1)
    share = (at_s - time_s[after - 1]) / (time_s[after] - time_s[after - 1])
    exact = np.abs(share - np.round(share)) * (time_s[after] - time_s[after - 1]) <= _SAME_TIME * period
    inside = np.isfinite(at_s) & (np.round(share) >= 0) & (np.round(share) <= 1)
    between = inside & (share >= 0) & (share <= 1) & (time_s[after] - time_s[after - 1] < 1.5 * period)
    weight = np.where(between, share, 0.0)[:, None, None]
    out = (1.0 - weight) * points_m[after - 1] + weight * points_m[after]
    out[~between] = np.nan
    hits = inside & exact
    out[hits] = points_m[after[hits] - 1 + np.round(share[hits]).astype(int)]
    return out


def _coverage(offsets_m: np.ndarray, covariance_m2: np.ndarray) -> tuple[float | None, float | None]:
    found = consistency(normalized_squares(offsets_m, unpack_covariance(covariance_m2)), 3)
    return (found.covered_68, found.covered_95) if found.n else (None, None)
