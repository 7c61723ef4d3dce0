"""Proposals from pairs of detections with a low energy E_pair, clustered by the distance d_prop.

Source: the specification of the articulated tracker, see docs/methods/specification.md. Every pair of detections of
different views is triangulated. Its energy adds reprojection errors, the squared cosecant of the angle between the rays
of each keypoint, and implausible bone lengths. Pairs with a low energy are proposals; proposals that are close to each
other are one person, at the mean of their points.
"""

from dataclasses import dataclass

import numpy as np

from posefuse.association.groups import FreeDetections, observe_detections
from posefuse.association.pairwise_baseline import with_covariance
from posefuse.association.proposal_distance import core_poses, proposal_distance
from posefuse.association.trunk import six, torso
from posefuse.kernels.association.pair_scores import triangulate_pairs
from posefuse.model.cameras import CameraRig
from posefuse.model.frames import Frame
from posefuse.model.graphs import connected_components
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions
from posefuse.model.options.specification import SpecificationOptions
from posefuse.model.proposals import Proposals
from posefuse.skeleton.limbs import core_limbs
from posefuse.skeleton.skeletons import Skeleton

_MIN_CONFIDENCE = 0.05
"""Confidence below which the noise of a keypoint no longer grows, as in the tracker."""
_MAX_LENGTH_RATIO, _MAX_SIDE_RATIO = 2.0, 1.5
"""Ratios of a limb to its mean over all people, and to the limb of the other side, that are plausible."""
_LOG_SD = 0.1
"""Scale of the excess of a logarithmic ratio of lengths."""
_MIN_SINE_SQUARED = 1e-6


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of detections with their points.

    Attributes:
        pair: shape (pair, 2), int64: indices of the two free detections.
        points_m: shape (pair, keypoint, 3), NaN where missing.
        covariance_m2: shape (pair, keypoint, 6).
        energy: shape (pair,): E_pair.
        n_common: shape (pair,), int64: number of common core keypoints.
    """

    pair: np.ndarray
    points_m: np.ndarray
    covariance_m2: np.ndarray
    energy: np.ndarray
    n_common: np.ndarray

    def select(self, which: np.ndarray) -> "Pairs":
        """Return some of the pairs, given by a mask or by indices."""
        return Pairs(*(each[which] for each in vars(self).values()))


def propose_by_energy(
    rig: CameraRig,
    noise: NoiseModel,
    skeleton: Skeleton,
    association: AssociationOptions,
    options: SpecificationOptions,
    frame: Frame,
    free: np.ndarray,
) -> Proposals:
    """Propose the people whom unassigned detections of a frame show in at least two views.

    Args:
        rig: Cameras, in the order of the frame's views.
        noise: Noise model of the detections.
        skeleton: Skeleton of the keypoints, with a tree.
        association: Volume, and minimum number of common keypoints.
        options: Weights of the energy, and scales of the distance.
        frame: The detections.
        free: shape (row,), bool: detections that are not assigned to a track.
    """
    detections = observe_detections(rig, frame, noise, np.arange(len(skeleton)), free, association)
    pairs = pairs_of(rig, frame, noise, skeleton, detections, options)
    good = (pairs.n_common >= association.min_common) & (pairs.energy <= options.pair_gate * pairs.n_common)
    if association.volume_m:
        low, high = np.reshape(association.volume_m, (2, 3))
        root_m = core_poses(pairs.points_m, pairs.covariance_m2, skeleton).root_m
        good &= ((root_m >= low) & (root_m <= high)).all(axis=-1)
    pairs = pairs.select(good)
    rows, clusters, duplicates = _claims(rig, detections, pairs, cluster_pairs(pairs, skeleton, options))
    if not clusters:
        return Proposals.none(len(skeleton), len(rig))
    merged = np.stack([_means(pairs.points_m[group]) for group in clusters])
    points = with_covariance(rig, frame, noise, skeleton, rows, merged, association)
    torso_m, torso_covariance_m2 = torso(skeleton, points.points_m, points.covariance_m2)
    energies = [float((pairs.energy[group] / pairs.n_common[group]).min()) for group in clusters]
    return Proposals(
        rows=rows,
        swapped=np.zeros(rows.shape, dtype=bool),
        points_m=points.points_m,
        covariance_m2=points.covariance_m2,
        status=points.status,
        used=points.used,
        torso_m=torso_m,
        torso_covariance_m2=torso_covariance_m2,
        log_odds=-0.5 * np.array(energies),
        error_sigma=points.error_sigma,
        n_views=(rows >= 0).sum(axis=1),
        n_pairs=np.array([len(group) for group in clusters]),
        duplicates=duplicates,
    ).solvable()


def pairs_of(
    rig: CameraRig,
    frame: Frame,
    noise: NoiseModel,
    skeleton: Skeleton,
    detections: FreeDetections,
    options: SpecificationOptions,
) -> Pairs:
    """Return all pairs of detections of different views, triangulated.

    Args:
        rig: Cameras.
        frame: The detections.
        noise: Noise model of the detections.
        skeleton: Skeleton of the keypoints, with a tree.
        detections: Unassigned detections with all keypoints.
        options: Weights of the energy.
    """
    pair = np.ascontiguousarray(np.argwhere(np.triu(detections.view[:, None] != detections.view[None, :])))
    shape = (len(pair), len(skeleton))
    points, errors = np.empty((*shape, 3)), np.empty((*shape, 2))
    triangulate_pairs(detections.rays, detections.weights, pair, points, errors)
    core = skeleton.core_indices
    n_common = np.isfinite(points[:, core]).all(axis=-1).sum(axis=1)
    energy = pair_energy(rig, frame, noise, skeleton, detections.rows[pair], points, options)
    return Pairs(pair, points, _covariance(detections, pair, points), energy, n_common)


def pair_energy(
    rig: CameraRig,
    frame: Frame,
    noise: NoiseModel,
    skeleton: Skeleton,
    rows: np.ndarray,
    points_m: np.ndarray,
    options: SpecificationOptions,
) -> np.ndarray:
    """Return E_pair: squared normalized reprojection errors, ray angles and implausible lengths, shape (pair,).

    Args:
        rig: Cameras.
        frame: The detections.
        noise: Noise model of the detections, which gives sigma_base.
        skeleton: Skeleton of the keypoints, with a tree.
        rows: shape (pair, 2), int64: rows of the frame.
        points_m: shape (pair, keypoint, 3), NaN where missing.
        options: Weights of the terms.
    """
    core_m = points_m[:, skeleton.core_indices]
    energy = options.anthropometric_weight * anthropometric_penalty(core_m, skeleton)
    centers_m = np.stack([camera.center_m for camera in rig.cameras])
    view = frame.view[rows]
    for side in range(2):
        pixels = frame.keypoints_px[rows[:, side]][:, skeleton.core_indices]
        confidence = frame.confidence[rows[:, side]][:, skeleton.core_indices]
        trust = np.maximum(np.where(np.isfinite(confidence), confidence, 1.0), _MIN_CONFIDENCE)
        variance = (noise.scale_px[view[:, side]][:, None] * trust**-noise.exponent) ** 2
        projected = np.empty(pixels.shape)
        for v in np.unique(view[:, side]):
            own = view[:, side] == v
            projected[own] = rig.cameras[v].project(core_m[own])[0]
        squared = ((pixels - projected) ** 2).sum(axis=-1) / variance
        energy = energy + np.where(np.isfinite(core_m[..., 0]), squared, 0.0).sum(axis=1)
    first, second = (core_m - centers_m[view[:, side]][:, None] for side in range(2))
    sine_squared = (np.cross(first, second) ** 2).sum(axis=-1) / ((first**2).sum(axis=-1) * (second**2).sum(axis=-1))
    cosecant_squared = 1.0 / np.maximum(sine_squared, _MIN_SINE_SQUARED)
    # A point that a camera cannot show has no projection: its energy is NaN, and no gate passes it.
    return energy + options.angle_weight * np.where(np.isfinite(core_m[..., 0]), cosecant_squared, 0.0).sum(axis=1)


def anthropometric_penalty(core_m: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return psi_anthro: the squared excess of implausible lengths and side ratios of core limbs, shape (...).

    Args:
        core_m: shape (..., core, 3), NaN where missing.
        skeleton: Skeleton with a tree.
    """
    tree = skeleton.tree
    assert tree is not None, "the tracker requires a tree"
    limbs = core_limbs(skeleton, tree)
    place = np.full(len(skeleton), -1)
    place[skeleton.core_indices] = np.arange(len(skeleton.core_indices))
    ends = core_m[..., place[limbs.keypoints], :]
    lengths = np.log(np.maximum(np.linalg.norm(ends[..., 0, :] - ends[..., 1, :], axis=-1), 1e-9))
    mean = np.log(limbs.lengths_m(tree, tree.shape_m))
    excess = np.maximum(np.abs(lengths - mean) - np.log(_MAX_LENGTH_RATIO), 0.0)
    paired = limbs.mirror > np.arange(len(limbs))
    sides = np.abs(lengths[..., paired] - lengths[..., limbs.mirror[paired]])
    uneven = np.maximum(sides - np.log(_MAX_SIDE_RATIO), 0.0)
    squared = np.concatenate([excess, uneven], axis=-1) ** 2 / _LOG_SD**2
    return np.where(np.isfinite(squared), squared, 0.0).sum(axis=-1)


def cluster_pairs(pairs: Pairs, skeleton: Skeleton, options: SpecificationOptions) -> list[np.ndarray]:
    """Return the clusters of pairs by single linkage of d_prop, as indices; the largest first."""
    n = len(pairs.pair)
    if not n:
        return []
    poses = core_poses(pairs.points_m, pairs.covariance_m2, skeleton)
    a, b = np.triu_indices(n, 1)
    near = np.eye(n, dtype=bool)
    near[a, b] = proposal_distance(poses.select(a), poses.select(b), options) <= options.cluster_gate
    labels = connected_components(near)
    clusters = [np.flatnonzero(labels == label) for label in range(int(labels.max()) + 1)]
    return sorted(clusters, key=lambda group: (-len(group), float((pairs.energy[group] / pairs.n_common[group]).min())))


def _claims(
    rig: CameraRig, detections: FreeDetections, pairs: Pairs, clusters: list[np.ndarray]
) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """Assign each detection to the largest cluster that contains it, one per view.

    Returns:
        Rows, shape (person, view); the pairs of each cluster with detections assigned to it; and detections of
        the same view and cluster that are not, shape (duplicate, 2).
    """
    claimed = np.zeros(len(detections.rows), dtype=bool)
    all_rows, kept, others = [], [], []
    for cluster in clusters:
        group = cluster[~claimed[pairs.pair[cluster]].any(axis=1)]
        votes = np.bincount(pairs.pair[group].ravel(), minlength=len(claimed))
        chosen = np.zeros(len(claimed), dtype=bool)
        for v in np.unique(detections.view[votes > 0]):
            here = np.flatnonzero((detections.view == v) & (votes > 0))
            chosen[here[np.argmax(votes[here])]] = True
        group = group[chosen[pairs.pair[group]].all(axis=1)]
        if not len(group):
            continue
        members = np.unique(pairs.pair[group])
        rows = np.full(len(rig), -1, dtype=np.int64)
        rows[detections.view[members]] = detections.rows[members]
        others += [(n, len(kept)) for n in np.flatnonzero(votes > 0)]
        claimed[members] = True
        all_rows.append(rows)
        kept.append(group)
    duplicates = {n: (detections.rows[n], cluster) for n, cluster in others if not claimed[n]}
    listed = np.array(list(duplicates.values()), dtype=np.int64).reshape(-1, 2)
    return np.array(all_rows, dtype=np.int64).reshape(-1, len(rig)), kept, listed


def _covariance(detections: FreeDetections, pair: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Return the covariances of points from the noise of two views, shape (pair, keypoint, 6)."""
    information = np.zeros((*points_m.shape[:2], 3, 3))
    for side in range(2):
        rays, weights = detections.rays[pair[:, side]], detections.weights[pair[:, side]]
        depth = np.einsum("pki,pki->pk", rays[..., 8:11], points_m) + rays[..., 11]
        for first in (0, 4):
            residual = np.einsum("pki,pki->pk", rays[..., first : first + 3], points_m) + rays[..., first + 3]
            slope = rays[..., first : first + 3] - (residual / depth)[..., None] * rays[..., 8:11]
            slope = slope / depth[..., None]
            information += weights[..., None, None] * slope[..., :, None] * slope[..., None, :]
    known = np.isfinite(information).all(axis=(-2, -1)) & (np.abs(np.linalg.det(np.nan_to_num(information))) > 0.0)
    covariance = np.linalg.inv(np.where(known[..., None, None], information, np.eye(3)))
    return np.where(known[..., None], six(covariance), np.nan)


def _means(points_m: np.ndarray) -> np.ndarray:
    """Return the means of finite points over the first axis, NaN where there are none."""
    finite = np.isfinite(points_m)
    count = finite.sum(axis=0)
    return np.where(count > 0, np.where(finite, points_m, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)
