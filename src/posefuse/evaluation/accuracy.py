"""Errors of 3D points against known positions, and what a result says of itself.

MPJPE is the mean distance over all points that are both in the result and in the truth (no alignment of any kind).
Missing points do not improve it: their share stands beside it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posefuse.errors import ResultError, choices
from posefuse.evaluation.consistency import consistency, normalised_squares
from posefuse.model.reconstruction import Layer, Reconstruction, unpack_covariance
from posefuse.model.status import is_used

FAR_M = 0.05
_SAME_TIME = 1e-3


@dataclass(frozen=True)
class Truth:
    """Known positions of one person, frame by frame with a result.

    Attributes:
        keypoints: names, of the result's skeleton.
        points_m: shape (frame, keypoint, 3), in the result's world, NaN where unknown.
        matched_by: how the frames were put together.
    """

    keypoints: tuple[str, ...]
    points_m: np.ndarray
    matched_by: str


@dataclass(frozen=True)
class Accuracy:
    """Distances to the truth, in mm, over all points in both.

    Attributes:
        layer: what was compared.
        matched_by: how frames were put together.
        n_frames: in how many frames something was compared.
        n_keypoints: how many keypoints were.
        n_points: how many points were compared.
        mpjpe_mm: mean distance.
        median_mm: and its percentiles.
        p90_mm: 90 %.
        p95_mm: 95 %.
        p99_mm: 99 %.
        share_beyond_50_mm: of the compared points.
        missing_share: of the points the truth has, those the result lacks.
        reprojection_median_px: over all used observations.
        bone_variation: median over bones of the robust relative spread of their length over time.
        covered_68: share of compared points inside the 68 % region of their covariance; None without covariances.
        covered_95: likewise of the 95 % region.
        median_mm_of: keypoint to its median distance.
        missing_share_of: keypoint to its share missing.
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


def evaluate(result: Reconstruction, truth: Truth) -> Accuracy:
    """Compare one person of a result with known positions.

    Args:
        result: of one person; ``options.layer`` or the best layer is compared.
        truth: of the same frames.

    Raises:
        ResultError: if the result has several people, frames do not fit, or no point is in both.
    """
    if result.unit != "m":
        raise ResultError(f"The result is in {result.unit} (one camera's image plane); there is no comparing it in 3D.")
    if len(result.person_ids) != 1:
        raise ResultError(
            f"The result has {len(result.person_ids)} people; this compares one. posefuse.score_people compares many."
        )
    name, layer = result.best_layer(result.options.layer)
    if truth.points_m.shape[0] != result.n_frames:
        raise ResultError(f"The truth has {truth.points_m.shape[0]} frames for {result.n_frames} of the result.")
    columns = [result.skeleton.index(keypoint) for keypoint in truth.keypoints]
    points = np.asarray(layer.points_m[:])[:, 0, columns]
    offsets = points - truth.points_m
    known = np.asarray(np.isfinite(truth.points_m).all(axis=-1))
    distance_mm = 1000.0 * np.linalg.norm(offsets, axis=-1)
    both = known & np.isfinite(distance_mm)
    if not both.any():
        raise ResultError("No point is both in the result and in the truth; are they of the same recording?")
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
    )


def median_reprojection_px(layer: Layer) -> float | None:
    """Median distance between observed and projected pixels over all used observations; None where there are none."""
    used = np.asarray(layer.view_error_px[:])[is_used(np.asarray(layer.view_status[:]))]
    used = used[np.isfinite(used)]
    return float(np.median(used)) if used.size else None


def bone_variation(points_m: np.ndarray, edges: np.ndarray) -> float | None:
    """How much bones change length: median over bones of 1.48 times the median deviation over the median length.

    Args:
        points_m: shape (frame, keypoint, 3).
        edges: shape (edge, 2).

    Returns:
        A share, or None without a bone that is seen twice.
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
    """Known positions from another reconstruction, such as the truth of a simulation; frames by their numbers.

    Raises:
        ResultError: if they share no frame or no keypoint.
    """
    shared = tuple(name for name in truth.skeleton.keypoints if name in result.skeleton.keypoints)
    if not shared:
        raise ResultError(f"Result ({result.skeleton.name}) and truth ({truth.skeleton.name}) share no keypoint names.")
    if len(truth.person_ids) != 1:
        raise ResultError(
            f"The truth has {len(truth.person_ids)} people; this compares one. posefuse.people_points takes many."
        )
    _, layer = truth.best_layer()
    columns = [truth.skeleton.index(name) for name in shared]
    if result.rate_hz and truth.rate_hz and abs(result.rate_hz / truth.rate_hz - 1.0) > 1e-3:
        points = np.asarray(layer.points_m[:])[:, 0][:, columns]
        return Truth(shared, interpolated(points, truth.time_s, result.time_s), "time")
    places = {int(number): i for i, number in enumerate(truth.frame_numbers)}
    rows = np.array([places.get(int(number), -1) for number in result.frame_numbers])
    if not (rows >= 0).any():
        raise ResultError("Result and truth share no frame number; are they of the same recording?")
    points = np.asarray(layer.points_m[:])[:, 0][:, columns][np.maximum(rows, 0)].copy()
    points[rows < 0] = np.nan
    return Truth(shared, points, "frame number")


def truth_from_trajectories(
    result: Reconstruction, names: tuple[str, ...], time_s: np.ndarray, points_m: np.ndarray
) -> Truth:
    """Known positions from named trajectories, in the result's world.

    Names may be canonical or another program's; of two for one keypoint the first counts. Frames are put together by
    order where there are equally many, else by time: the truth is interpolated linearly between its own frames.

    Raises:
        ResultError: if no name is known, or no time fits.
    """
    places: dict[str, int] = {}
    for i, name in enumerate(names):
        keypoint = result.skeleton.canonical(name)
        if keypoint is not None:
            places.setdefault(keypoint, i)
    found = [(i, name) for name, i in places.items()]
    if not found:
        raise ResultError(f"The truth's points ({choices(names)}) are none of skeleton {result.skeleton.name}'s.")
    points = np.asarray(points_m)[:, [i for i, _ in found]]
    keypoints = tuple(name for _, name in found)
    if len(points) == result.n_frames:
        return Truth(keypoints, points, "order")
    if not np.isfinite(result.time_s).any():
        raise ResultError(
            f"The result has {result.n_frames} frames without times and the truth {len(points)}: there is no telling "
            "which belong together. Reconstruct with the frame rate (--rate-hz), or cut the truth to the same frames."
        )
    if len(time_s) < 2 or not np.all(np.diff(time_s) > 0):
        raise ResultError(f"The truth's {len(time_s)} times must be at least two, and increase.")
    matched = interpolated(points, time_s, result.time_s)
    if not np.isfinite(matched).any():
        raise ResultError(
            f"No frame of the result ({np.nanmin(result.time_s):.3f} to {np.nanmax(result.time_s):.3f} s) lies within "
            f"the truth's times ({time_s[0]:.3f} s to {time_s[-1]:.3f} s); are they of the same recording?"
        )
    return Truth(keypoints, matched, "time")


def interpolated(points_m: np.ndarray, time_s: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """Positions between frames, linearly; NaN outside, in gaps of the frames, and beside missing points.

    Args:
        points_m: shape (frame, keypoint, 3).
        time_s: shape (frame,), increasing.
        at_s: shape (other frame,), NaN where unknown.

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
    found = consistency(normalised_squares(offsets_m, unpack_covariance(covariance_m2)), 3)
    return (found.covered_68, found.covered_95) if found.n else (None, None)
