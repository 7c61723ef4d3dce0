"""People as groups of detections: pairs grown to at most one detection per view, by their odds.

The odds of a pair are the likelihood ratio of the distance between its rays if both detections show one person, and if
they do not, accumulated over the core keypoints. The points of a group predict the person's pixels in the other views
with a covariance, which gives the odds of every further detection. Implausible bone lengths, and views that should show
the person and do not, count against a group. See docs/methods/association.md.
"""

import math
from dataclasses import dataclass

import numpy as np

from posefuse.arrays import frozen
from posefuse.association.group_points import triangulate_groups
from posefuse.association.trunk import torso
from posefuse.kernels.association import groups as kernels
from posefuse.kernels.association.group_points import compute_observations
from posefuse.kernels.association.groups import FrameContext, GroupTable
from posefuse.kernels.association.log_odds import CandidateDetections, OddsParameters
from posefuse.kernels.association.pair_scores import find_near_people, score_pairs, score_support
from posefuse.kernels.cameras.lens import FX, FY
from posefuse.kernels.records import Detections, NoiseParameters
from posefuse.model.cameras import CameraRig
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions
from posefuse.model.proposals import Proposals
from posefuse.skeleton.skeletons import Skeleton


@dataclass(frozen=True)
class FreeDetections:
    """Unassigned detections of a frame, as observations of keypoints.

    Attributes:
        rows: shape (detection,), int64: rows of the frame.
        view: shape (detection,), int64.
        rays: shape (detection, core, 12), observation rows.
        weights: shape (detection, core), 1/px^2.
    """

    rows: np.ndarray
    view: np.ndarray
    rays: np.ndarray
    weights: np.ndarray


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
    core = skeleton.core_indices
    detections = observe_detections(rig, frame, noise, core, free, options)
    candidates = CandidateDetections(
        views=detections.view,
        rays=detections.rays,
        weights=detections.weights,
        mirror=skeleton.core_mirror,
        bones=skeleton.core_bones,
        allowed=compatible_pairs(rig, core, detections, options, known_m),
        clutter_px=options.clutter_share * np.array([camera.size_px[0] for camera in rig.cameras], dtype=np.float64),
    )
    parameters = _odds_parameters(options)
    evidence, seeds = _seeds(len(rig), candidates, parameters, options)
    groups = _form_groups(rig, frame, detections.rows, core, candidates, parameters, evidence, seeds)
    accepted = np.flatnonzero(groups.statistics[:, kernels.STATE] == kernels.ACCEPTED)
    accepted = accepted[np.argsort(-groups.statistics[accepted, kernels.ODDS], kind="stable")]
    if not len(accepted):
        return Proposals.none(len(skeleton), len(rig))
    members, swapped = groups.members[accepted], groups.swapped[accepted]
    rows = np.where(members >= 0, detections.rows[members], -1)
    points = triangulate_groups(rig, frame, noise, skeleton, rows, swapped, options)
    torso_m, torso_covariance_m2 = torso(skeleton, points.points_m, points.covariance_m2)
    return Proposals(
        rows=rows,
        swapped=swapped,
        points_m=points.points_m,
        covariance_m2=points.covariance_m2,
        status=points.status,
        used=points.used,
        torso_m=torso_m,
        torso_covariance_m2=torso_covariance_m2,
        log_odds=groups.statistics[accepted, kernels.ODDS] + options.prior_log_odds,
        error_sigma=points.error_sigma,
        n_views=(rows >= 0).sum(axis=1),
        n_pairs=groups.statistics[accepted, kernels.N_PAIRS].astype(np.int64),
        duplicates=_duplicates(detections.rows, groups.duplicate_of, accepted),
    )


def observe_detections(
    rig: CameraRig,
    frame: Frame,
    noise: NoiseModel,
    keypoints: np.ndarray,
    free: np.ndarray,
    options: AssociationOptions,
) -> FreeDetections:
    """Return the unassigned detections as observations of some keypoints, given by their indices, shape (core,)."""
    rows = np.flatnonzero(free)
    rays, weights = np.empty((len(rows), len(keypoints), 12)), np.empty((len(rows), len(keypoints)))
    compute_observations(
        rig.packed,
        Detections(frame.keypoints_px, frame.confidence, frame.view),
        NoiseParameters(noise.scale_px * options.sigma_factor, noise.exponent, options.min_confidence),
        rows,
        frozen(keypoints, np.int64),
        rays,
        weights,
    )
    return FreeDetections(rows, frame.view[rows], rays, weights)


def compatible_pairs(
    rig: CameraRig,
    keypoints: np.ndarray,
    detections: FreeDetections,
    options: AssociationOptions,
    known_m: np.ndarray | None,
) -> np.ndarray:
    """Return the pairs that do not contradict known people, shape (detection, detection), bool.

    Two detections may show one person if both show the same known one, or neither shows any.
    """
    if known_m is None or not len(known_m):
        return np.ones((len(detections.rows), len(detections.rows)), dtype=bool)
    near = np.empty((len(detections.rows), len(known_m)), dtype=bool)
    cameras = rig.packed
    find_near_people(
        detections.rays,
        detections.weights,
        detections.view,
        np.ascontiguousarray(known_m, dtype=np.float64),
        np.sqrt(cameras[:, FX] * cameras[:, FY]),
        options.known_person_distance_m,
        keypoints,
        near,
    )
    unknown = np.asarray(~near.any(axis=1))
    shared = near.astype(np.int64) @ near.T > 0
    return shared | (unknown[:, None] & unknown[None, :])


def _odds_parameters(options: AssociationOptions) -> OddsParameters:
    return OddsParameters(
        min_common=options.min_common,
        outlier_share=options.outlier_share,
        independent=options.independent_keypoints,
        independent_bones=options.independent_bones,
        join=options.join_log_odds,
        swap=options.swap_log_odds,
        miss=options.miss_log_odds,
        prior=options.prior_log_odds,
        near=options.duplicate_sigma,
        max_seeds=options.max_seeds,
    )


def _seeds(
    n_views: int, candidates: CandidateDetections, parameters: OddsParameters, options: AssociationOptions
) -> tuple[np.ndarray, np.ndarray]:
    """Return log odds of pairs (detection, detection) and seeds of groups (seed, 3), best first."""
    n = len(candidates.views)
    evidence, seed, supported = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    volume = np.array(options.volume_m or [-math.inf] * 3 + [math.inf] * 3)
    score_pairs(candidates, parameters, volume, evidence, seed)
    score_support(seed, evidence, candidates.views, n_views, supported)
    # A pair that remains unlikely with its best supporting pairs is no seed.
    enough = np.count_nonzero(supported + parameters.prior > 0.0)
    order = np.argsort(-supported, axis=None, kind="stable")[:enough]
    seeds = np.empty((enough, 3))
    seeds[:, 0], seeds[:, 1] = np.divmod(order, n)
    seeds[:, 2] = supported.ravel()[order]
    return evidence, seeds


def _form_groups(
    rig: CameraRig,
    frame: Frame,
    rows: np.ndarray,
    core: np.ndarray,
    candidates: CandidateDetections,
    parameters: OddsParameters,
    evidence: np.ndarray,
    seeds: np.ndarray,
) -> GroupTable:
    """Return the groups that formed, accepted or not."""
    room = min(len(seeds), parameters.max_seeds) * 2 + len(rows)
    groups = GroupTable(
        members=np.empty((room, len(rig)), dtype=np.int64),
        swapped=np.empty((room, len(rig)), dtype=bool),
        statistics=np.empty((room, kernels.GROUP_COLUMNS)),
        duplicate_of=np.empty(len(rows), dtype=np.int64),
    )
    sizes_px = np.array([camera.size_px for camera in rig.cameras], dtype=np.float64)
    context = FrameContext(
        cameras=rig.packed,
        sizes_px=np.where(frame.recorded[:, None], sizes_px, 0.0),
        boxes_px=frame.boxes_px,
        box_starts=np.searchsorted(frame.view, np.arange(len(rig) + 1)),
    )
    pixels = frame.keypoints_px[rows[:, None], core]
    n_groups = kernels.form_groups(candidates, parameters, context, pixels, evidence, seeds, groups)
    return GroupTable(
        groups.members[:n_groups], groups.swapped[:n_groups], groups.statistics[:n_groups], groups.duplicate_of
    )


def _duplicates(rows: np.ndarray, duplicate_of: np.ndarray, accepted: np.ndarray) -> np.ndarray:
    """Return rows that duplicate a member and the indices of their proposals, shape (duplicate, 2)."""
    again = np.flatnonzero(duplicate_of >= 0)
    order = np.argsort(accepted)
    person = order[np.searchsorted(accepted[order], duplicate_of[again])]
    return np.stack([rows[again], person], axis=1)
