"""The baseline: pairs of detections triangulated, scored, grouped and averaged in 3D.

After RapidPoseTriangulation (arXiv 2503.21692), as far as its steps and numbers are known. Every pair of detections of
different views gives a body; a keypoint's score falls with its mean reprojection error as a share of the image size,
and with the distance from the cameras; pairs of good bodies near each other are one person, whose keypoints are the
mean of the nearest few. It enforces neither one detection a view nor a detection in one person only, and knows no
noise; here the best detection of each view is named, the others are its duplicates, and covariances are those that the
named detections would give by maximum likelihood.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.association.group_points import Points, median_error_sigma, solve
from posefuse.association.groups import Seen, look, may_pair
from posefuse.association.trunk import torso
from posefuse.kernels import status_codes
from posefuse.kernels.association.pair_scores import triangulate_pairs
from posefuse.model.cameras import CameraRig
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions, RptOptions
from posefuse.model.proposals import Proposals
from posefuse.skeleton.skeletons import Skeleton

# Of the score 1 / (1 + 10 e), e the error as a share of the image, clipped, at this distance.
_STEEPNESS = 10.0
_CLIPPED = 0.25
_USUAL_DISTANCE_M = 3.5
_DROPPED_SHARE = 0.2


@dataclass(frozen=True)
class Bodies:
    """What pairs of detections make.

    Attributes:
        pair: shape (body, 2), int64: detections.
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
    """People in the free detections of a frame; arguments as of :func:`posefuse.association.proposals.propose`."""
    every = np.arange(len(skeleton))
    seen = look(rig, frame, noise, every, free, options)
    allowed = may_pair(rig, every, seen, options, known_m)
    bodies = _good(_bodies(rig, seen, allowed), skeleton, options)
    people = [group for group in _groups(bodies, skeleton, options.rpt) if len(group) >= options.rpt.min_pairs]
    if not people:
        return Proposals.none(len(skeleton), len(rig))
    score = np.array([bodies.score[group].mean() for group in people])
    order = np.argsort(-score, kind="stable")
    people, score = [people[i] for i in order], score[order]
    merged = np.stack([_merge(bodies, group, options.rpt) for group in people])
    rows, duplicates = _claims(rig, seen, bodies, people)
    points = _with_covariance(rig, frame, noise, skeleton, rows, merged, options)
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


def _bodies(rig: CameraRig, seen: Seen, allowed: np.ndarray) -> Bodies:
    """Every allowed pair's keypoints and their scores."""
    a, b = np.nonzero(np.triu(allowed & (seen.view[:, None] != seen.view[None, :])))
    points, errors_px = np.empty((len(a), seen.weights.shape[1], 3)), np.empty((len(a), seen.weights.shape[1], 2))
    pair = np.stack([a, b], axis=1)
    triangulate_pairs(seen.rays, seen.weights, pair, points, errors_px)
    size_px = np.array([sum(camera.size_px) / 2.0 for camera in rig.cameras])
    centre_m = np.stack([camera.centre_m for camera in rig.cameras])
    view = seen.view[pair]
    away = np.linalg.norm(points[:, :, None] - centre_m[view][:, None], axis=-1).mean(axis=-1)
    error = np.minimum(errors_px / size_px[view][:, None], _CLIPPED).mean(axis=-1)
    scores = 1.0 / (1.0 + _STEEPNESS * error * np.sqrt(away / _USUAL_DISTANCE_M))
    return Bodies(pair, points, np.nan_to_num(scores, nan=0.0), np.zeros(len(a)))


def _good(bodies: Bodies, skeleton: Skeleton, options: AssociationOptions) -> Bodies:
    """The bodies that score well over the core, its worst keypoints left out, and lie where people can be."""
    ranked = -np.sort(-bodies.scores[:, skeleton.core_indices], axis=1)
    known = np.count_nonzero(ranked, axis=1)
    kept = np.maximum(known - np.floor(_DROPPED_SHARE * known).astype(np.int64), 1)
    score = np.cumsum(ranked, axis=1)[np.arange(len(ranked)), np.minimum(kept, ranked.shape[1]) - 1] / kept
    good = (known >= options.min_common) & (score >= options.rpt.min_score)
    if options.volume_m:
        centre = _centres(bodies.points_m[good][:, skeleton.core_indices])
        low, high = np.reshape(options.volume_m, (2, 3))
        good[good] = ((centre >= low) & (centre <= high)).all(axis=1)
    return Bodies(bodies.pair[good], bodies.points_m[good], bodies.scores[good], score[good])


def _groups(bodies: Bodies, skeleton: Skeleton, options: RptOptions) -> list[list[int]]:
    """Bodies near each other, the best first; each joins the first group whose running mean is near."""
    core = bodies.points_m[:, skeleton.core_indices]
    groups: list[list[int]] = []
    for i in np.argsort(-bodies.score, kind="stable").tolist():
        for group in groups:
            mean = _means(core[group])
            apart = np.linalg.norm(mean - core[i], axis=-1)
            centre = np.linalg.norm(_centres(mean[None])[0] - _centres(core[i : i + 1])[0])
            common = np.isfinite(apart)
            near = common.any() and apart[common].mean() < options.keypoint_distance_m
            if centre < options.center_distance_m and near:
                group.append(i)
                break
        else:
            groups.append([i])
    return groups


def _merge(bodies: Bodies, group: list[int], options: RptOptions) -> np.ndarray:
    """Shape (keypoint, 3): of each keypoint the mean of the few nearest to the mean of all that score well."""
    points = np.where(bodies.scores[group][..., None] >= options.min_joint_score, bodies.points_m[group], np.nan)
    away = np.linalg.norm(points - _means(points), axis=-1)
    points = np.where(away[..., None] <= options.outlier_distance_m, points, np.nan)
    away = np.nan_to_num(np.linalg.norm(points - _means(points), axis=-1), nan=np.inf)
    nearest = np.argsort(away, axis=0, kind="stable")[: options.merged_pairs]
    return _means(np.take_along_axis(points, nearest[..., None], axis=0))


def _claims(rig: CameraRig, seen: Seen, bodies: Bodies, people: list[list[int]]) -> tuple[np.ndarray, np.ndarray]:
    """Each person's detection in every view, that of most score; what else supported them repeats it.

    Returns:
        Rows, shape (person, view), and duplicates, shape (duplicate, 2).
    """
    rows, again = np.full((len(people), len(rig)), -1, dtype=np.int64), []
    claimed = np.zeros(len(seen.rows), dtype=bool)
    for person, group in enumerate(people):
        worth = np.zeros(len(seen.rows))
        np.add.at(worth, bodies.pair[group].ravel(), np.repeat(bodies.score[group], 2))
        worth[claimed] = 0.0
        for v in range(len(rig)):
            here = np.flatnonzero((seen.view == v) & (worth > 0.0))
            if len(here):
                best = here[np.argmax(worth[here])]
                rows[person, v] = seen.rows[best]
                again += [(seen.rows[n], person) for n in here if n != best]
        claimed |= worth > 0.0
    return rows, np.array(again, dtype=np.int64).reshape(-1, 2)


def _with_covariance(
    rig: CameraRig,
    frame: Frame,
    noise: NoiseModel,
    skeleton: Skeleton,
    rows: np.ndarray,
    merged: np.ndarray,
    options: AssociationOptions,
) -> Points:
    """The merged points with the covariances and views of the robust points of the same detections."""
    solved = solve(rig, frame, noise, skeleton, rows, np.zeros(rows.shape, dtype=bool), options)
    both = np.isfinite(merged).all(axis=-1) & (solved.status < status_codes.POINT_MISSING)
    status = np.where(both | (solved.status >= status_codes.POINT_MISSING), solved.status, status_codes.POINT_OUTLIER)
    used = solved.used & both[..., None]
    merged = np.where(both[..., None], merged, np.nan)
    projected = np.moveaxis(rig.project(merged), 0, 2)
    taken = np.moveaxis(frame.keypoints_px[rows], 1, 2)
    error_px = np.linalg.norm(projected - taken, axis=-1)
    return Points(
        merged,
        np.where(both[..., None], solved.covariance_m2, np.nan),
        status.astype(np.int8),
        used,
        median_error_sigma(error_px, used, frame.confidence, rows, noise),
    )


def _means(points: np.ndarray) -> np.ndarray:
    """Means over the first axis of what is not NaN; NaN where nothing is."""
    seen = np.isfinite(points)
    count = seen.sum(axis=0)
    return np.where(count > 0, np.where(seen, points, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def _centres(points: np.ndarray) -> np.ndarray:
    """Shape (body, 3): the mean of each body's known keypoints."""
    return _means(np.moveaxis(points, 1, 0))
