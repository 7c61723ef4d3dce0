"""Pairwise baseline: pairs of detections triangulated, scored, grouped and averaged in 3D.

The method follows RapidPoseTriangulation (arXiv 2503.21692) where its steps and numbers are published. Every pair of
detections of different views gives a body. The score of a keypoint decreases with its mean reprojection error relative
to the image size and with the distance from the cameras. Bodies with a high score that are close to each other are one
person, whose keypoints are the mean of the nearest few. The method enforces neither one detection per view nor one
person per detection, and has no noise model. Here the best detection of each view is assigned, the others are its
duplicates, and the covariances are those of the maximum-likelihood points of the assigned detections.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.association.group_points import GroupPoints, median_error_sigma, triangulate_groups
from posefuse.association.groups import FreeDetections, compatible_pairs, observe_detections
from posefuse.association.trunk import torso
from posefuse.kernels import status_codes
from posefuse.kernels.association.pair_scores import triangulate_pairs
from posefuse.model.cameras import CameraRig
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions, RptOptions
from posefuse.model.proposals import Proposals
from posefuse.skeleton.skeletons import Skeleton


@dataclass(frozen=True)
class PairBodies:
    """Bodies triangulated from pairs of detections.

    Attributes:
        pair: shape (body, 2), int64: indices of the two detections.
        points_m: shape (body, keypoint, 3), NaN where missing.
        scores: shape (body, keypoint), 0 where missing.
        score: shape (body,).
    """

    pair: np.ndarray
    points_m: np.ndarray
    scores: np.ndarray
    score: np.ndarray


def propose(
    rig: CameraRig,
    frame: Frame,
    noise: NoiseModel,
    skeleton: Skeleton,
    free: np.ndarray,
    options: AssociationOptions,
    known_m: np.ndarray | None = None,
) -> Proposals:
    """Propose people from unassigned detections; arguments as of :func:`posefuse.association.proposals.propose`."""
    every = np.arange(len(skeleton))
    detections = observe_detections(rig, frame, noise, every, free, options)
    allowed = compatible_pairs(rig, every, detections, options, known_m)
    bodies = _good(_bodies(rig, detections, allowed, options.rpt), skeleton, options)
    people = [group for group in _groups(bodies, skeleton, options.rpt) if len(group) >= options.rpt.min_pairs]
    if not people:
        return Proposals.none(len(skeleton), len(rig))
    score = np.array([bodies.score[group].mean() for group in people])
    order = np.argsort(-score, kind="stable")
    people, score = [people[i] for i in order], score[order]
    merged = np.stack([_merge(bodies, group, options.rpt) for group in people])
    rows, duplicates = _claims(rig, detections, bodies, people)
    points = with_covariance(rig, frame, noise, skeleton, rows, merged, options)
    torso_m, torso_covariance_m2 = torso(skeleton, points.points_m, points.covariance_m2)
    share = np.clip(score, 1e-6, 1.0 - 1e-6)
    return Proposals(
        rows=rows,
        swapped=np.zeros(rows.shape, dtype=bool),
        points_m=points.points_m,
        covariance_m2=points.covariance_m2,
        status=points.status,
        used=points.used,
        torso_m=torso_m,
        torso_covariance_m2=torso_covariance_m2,
        log_odds=np.log(share / (1.0 - share)),
        error_sigma=points.error_sigma,
        n_views=(rows >= 0).sum(axis=1),
        n_pairs=np.array([len(group) for group in people]),
        duplicates=duplicates,
    )


def _bodies(rig: CameraRig, detections: FreeDetections, allowed: np.ndarray, options: RptOptions) -> PairBodies:
    """Return the keypoints of all allowed pairs and their scores."""
    a, b = np.nonzero(np.triu(allowed & (detections.view[:, None] != detections.view[None, :])))
    points, errors_px = (
        np.empty((len(a), detections.weights.shape[1], 3)),
        np.empty((len(a), detections.weights.shape[1], 2)),
    )
    pair = np.stack([a, b], axis=1)
    triangulate_pairs(detections.rays, detections.weights, pair, points, errors_px)
    size_px = np.array([sum(camera.size_px) / 2.0 for camera in rig.cameras])
    centers_m = np.stack([camera.center_m for camera in rig.cameras])
    view = detections.view[pair]
    away = np.linalg.norm(points[:, :, None] - centers_m[view][:, None], axis=-1).mean(axis=-1)
    error = np.minimum(errors_px / size_px[view][:, None], options.max_error_share).mean(axis=-1)
    scores = 1.0 / (1.0 + options.score_steepness * error * np.sqrt(away / options.reference_distance_m))
    return PairBodies(pair, points, np.nan_to_num(scores, nan=0.0), np.zeros(len(a)))


def _good(bodies: PairBodies, skeleton: Skeleton, options: AssociationOptions) -> PairBodies:
    """Return the bodies with a high score over the core, without its worst keypoints, and inside the volume."""
    ranked = -np.sort(-bodies.scores[:, skeleton.core_indices], axis=1)
    known = np.count_nonzero(ranked, axis=1)
    kept = np.maximum(known - np.floor(options.rpt.dropped_share * known).astype(np.int64), 1)
    score = np.cumsum(ranked, axis=1)[np.arange(len(ranked)), np.minimum(kept, ranked.shape[1]) - 1] / kept
    good = (known >= options.min_common) & (score >= options.rpt.min_score)
    if options.volume_m:
        center = _centers(bodies.points_m[good][:, skeleton.core_indices])
        low, high = np.reshape(options.volume_m, (2, 3))
        good[good] = ((center >= low) & (center <= high)).all(axis=1)
    return PairBodies(bodies.pair[good], bodies.points_m[good], bodies.scores[good], score[good])


def _groups(bodies: PairBodies, skeleton: Skeleton, options: RptOptions) -> list[list[int]]:
    """Group bodies, the best first; each joins the first group whose running mean is close."""
    core = bodies.points_m[:, skeleton.core_indices]
    groups: list[list[int]] = []
    for i in np.argsort(-bodies.score, kind="stable").tolist():
        for group in groups:
            mean = _means(core[group])
            apart = np.linalg.norm(mean - core[i], axis=-1)
            center = np.linalg.norm(_centers(mean[None])[0] - _centers(core[i : i + 1])[0])
            common = np.isfinite(apart)
            near = common.any() and apart[common].mean() < options.keypoint_distance_m
            if center < options.center_distance_m and near:
                group.append(i)
                break
        else:
            groups.append([i])
    return groups


def _merge(bodies: PairBodies, group: list[int], options: RptOptions) -> np.ndarray:
    """Return the mean of the few keypoints closest to the mean of all with a high score, shape (keypoint, 3)."""
    points = np.where(bodies.scores[group][..., None] >= options.min_joint_score, bodies.points_m[group], np.nan)
    away = np.linalg.norm(points - _means(points), axis=-1)
    points = np.where(away[..., None] <= options.outlier_distance_m, points, np.nan)
    away = np.nan_to_num(np.linalg.norm(points - _means(points), axis=-1), nan=np.inf)
    nearest = np.argsort(away, axis=0, kind="stable")[: options.merged_pairs]
    return _means(np.take_along_axis(points, nearest[..., None], axis=0))


def _claims(
    rig: CameraRig, detections: FreeDetections, bodies: PairBodies, people: list[list[int]]
) -> tuple[np.ndarray, np.ndarray]:
    """Return each person's detection with the highest score in every view, and the duplicates of these detections.

    Returns:
        Rows, shape (person, view); and duplicates, shape (duplicate, 2).
    """
    rows, again = np.full((len(people), len(rig)), -1, dtype=np.int64), []
    claimed = np.zeros(len(detections.rows), dtype=bool)
    for person, group in enumerate(people):
        worth = np.zeros(len(detections.rows))
        np.add.at(worth, bodies.pair[group].ravel(), np.repeat(bodies.score[group], 2))
        worth[claimed] = 0.0
        for v in range(len(rig)):
            here = np.flatnonzero((detections.view == v) & (worth > 0.0))
            if len(here):
                best = here[np.argmax(worth[here])]
                rows[person, v] = detections.rows[best]
                again += [(detections.rows[n], person) for n in here if n != best]
        claimed |= worth > 0.0
    return rows, np.array(again, dtype=np.int64).reshape(-1, 2)


def with_covariance(
    rig: CameraRig,
    frame: Frame,
    noise: NoiseModel,
    skeleton: Skeleton,
    rows: np.ndarray,
    merged: np.ndarray,
    options: AssociationOptions,
) -> GroupPoints:
    """Return the merged points with the covariances and views of the robust points of the same detections."""
    solved = triangulate_groups(rig, frame, noise, skeleton, rows, np.zeros(rows.shape, dtype=bool), options)
    both = np.isfinite(merged).all(axis=-1) & (solved.status < status_codes.POINT_MISSING)
    status = np.where(both | (solved.status >= status_codes.POINT_MISSING), solved.status, status_codes.POINT_OUTLIER)
    used = solved.used & both[..., None]
    merged = np.where(both[..., None], merged, np.nan)
    projected = np.moveaxis(rig.project(merged), 1, 2)
    taken = np.moveaxis(frame.keypoints_px[rows], 1, 2)
    error_px = np.linalg.norm(projected - taken, axis=-1)
    return GroupPoints(
        merged,
        np.where(both[..., None], solved.covariance_m2, np.nan),
        status.astype(np.int8),
        used,
        median_error_sigma(error_px, used, frame.confidence, rows, noise),
    )


def _means(points: np.ndarray) -> np.ndarray:
    """Return means of finite values over the first axis; NaN where there are none."""
    finite = np.isfinite(points)
    count = finite.sum(axis=0)
    return np.where(count > 0, np.where(finite, points, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def _centers(points: np.ndarray) -> np.ndarray:
    """Return the mean of each body's known keypoints, shape (body, 3)."""
    return _means(np.moveaxis(points, 1, 0))
