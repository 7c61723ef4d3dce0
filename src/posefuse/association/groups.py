"""People as groups of detections: pairs by the odds that they show one person, grown to at most one detection a view.

The odds of a pair are how much likelier its rays would pass so near each other if both detections showed one person
than if they did not, keypoint by keypoint over the core. A group's points say where its person should be seen in the
other views, and how certainly: that gives the odds of every further detection. Bones that no body has, and views that
should show the person and do not, count against a group; the rest is arithmetic. See docs/methods/association.md.
"""

import math
from dataclasses import dataclass

import numpy as np

from posefuse.arrays import frozen
from posefuse.association.group_points import solve
from posefuse.association.trunk import torso
from posefuse.kernels.association import groups as kernels
from posefuse.kernels.association.group_points import compute_observations
from posefuse.kernels.association.groups import FrameContext, GroupTable
from posefuse.kernels.association.log_odds import CandidateDetections, OddsParameters
from posefuse.kernels.association.pair_scores import find_near_people, score_pairs, score_support
from posefuse.kernels.cameras.lens import FX, FY
from posefuse.model.cameras import CameraRig
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions
from posefuse.model.proposals import Proposals
from posefuse.skeleton.skeletons import Skeleton


@dataclass(frozen=True)
class Seen:
    """The free detections of a frame, as observations of core keypoints.

    Attributes:
        rows: shape (detection,), int64: of the frame.
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
    """People in the free detections of a frame; arguments as of :func:`posefuse.association.proposals.propose`."""
    core = skeleton.core_indices
    seen = look(rig, frame, noise, core, free, options)
    sight = CandidateDetections(
        views=seen.view,
        rays=seen.rays,
        weights=seen.weights,
        mirror=skeleton.core_mirror,
        bones=skeleton.core_bones,
        allowed=may_pair(rig, core, seen, options, known_m),
        clutter_px=options.clutter_share * np.array([camera.size_px[0] for camera in rig.cameras], dtype=np.float64),
    )
    law = _law(options)
    evidence, seeds = _seeds(len(rig), sight, law, options)
    drafts = _grow(rig, frame, seen.rows, core, sight, law, evidence, seeds)
    taken = np.flatnonzero(drafts.statistics[:, kernels.STATE] == kernels.ACCEPTED)
    taken = taken[np.argsort(-drafts.statistics[taken, kernels.ODDS], kind="stable")]
    if not len(taken):
        return Proposals.none(len(skeleton), len(rig))
    members, swapped = drafts.members[taken], drafts.swapped[taken]
    rows = np.where(members >= 0, seen.rows[members], -1)
    points = solve(rig, frame, noise, skeleton, rows, swapped, options)
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
        log_odds=drafts.statistics[taken, kernels.ODDS] + options.prior_log_odds,
        error_sigma=points.error_sigma,
        n_views=(rows >= 0).sum(axis=1),
        n_pairs=drafts.statistics[taken, kernels.N_PAIRS].astype(np.int64),
        duplicates=_duplicates(seen.rows, drafts.duplicate_of, taken),
    )


def look(
    rig: CameraRig,
    frame: Frame,
    noise: NoiseModel,
    keypoints: np.ndarray,
    free: np.ndarray,
    options: AssociationOptions,
) -> Seen:
    """The free detections as observations of some keypoints, given by their places, shape (core,)."""
    rows = np.flatnonzero(free)
    rays, weights = np.empty((len(rows), len(keypoints), 12)), np.empty((len(rows), len(keypoints)))
    compute_observations(
        *rig.packed,
        frame.keypoints_px,
        frame.confidence,
        frame.view,
        rows,
        frozen(keypoints, np.int64),
        noise.scale_px * options.sigma_factor,
        noise.exponent,
        options.min_confidence,
        rays,
        weights,
    )
    return Seen(rows, frame.view[rows], rays, weights)


def may_pair(
    rig: CameraRig, keypoints: np.ndarray, seen: Seen, options: AssociationOptions, known_m: np.ndarray | None
) -> np.ndarray:
    """Shape (detection, detection), bool: which pairs do not contradict the people already known.

    Two detections may show one person if both show the same known one, or neither shows any.
    """
    if known_m is None or not len(known_m):
        return np.ones((len(seen.rows), len(seen.rows)), dtype=bool)
    near = np.empty((len(seen.rows), len(known_m)), dtype=bool)
    cameras = rig.packed[0]
    find_near_people(
        seen.rays,
        seen.weights,
        seen.view,
        np.ascontiguousarray(known_m, dtype=np.float64),
        np.sqrt(cameras[:, FX] * cameras[:, FY]),
        options.known_person_distance_m,
        keypoints,
        near,
    )
    nobody = np.asarray(~near.any(axis=1))
    shared = near.astype(np.int64) @ near.T > 0
    return shared | (nobody[:, None] & nobody[None, :])


def _law(options: AssociationOptions) -> OddsParameters:
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
    n_views: int, sight: CandidateDetections, law: OddsParameters, options: AssociationOptions
) -> tuple[np.ndarray, np.ndarray]:
    """Log odds of all pairs, shape (detection, detection), and those worth growing, best first, shape (seed, 3)."""
    n = len(sight.views)
    evidence, seed, supported = np.empty((n, n)), np.empty((n, n)), np.empty((n, n))
    volume = np.array(options.volume_m or [-math.inf] * 3 + [math.inf] * 3)
    score_pairs(sight, law, volume, evidence, seed)
    score_support(seed, evidence, sight.views, n_views, supported)
    # What even its best friends do not make likely is not worth growing.
    enough = np.count_nonzero(supported + law.prior > 0.0)
    order = np.argsort(-supported, axis=None, kind="stable")[:enough]
    seeds = np.empty((enough, 3))
    seeds[:, 0], seeds[:, 1] = np.divmod(order, n)
    seeds[:, 2] = supported.ravel()[order]
    return evidence, seeds


def _grow(
    rig: CameraRig,
    frame: Frame,
    rows: np.ndarray,
    core: np.ndarray,
    sight: CandidateDetections,
    law: OddsParameters,
    evidence: np.ndarray,
    seeds: np.ndarray,
) -> GroupTable:
    """The groups that grew, taken or not."""
    room = min(len(seeds), law.max_seeds) * 2 + len(rows)
    drafts = GroupTable(
        members=np.empty((room, len(rig)), dtype=np.int64),
        swapped=np.empty((room, len(rig)), dtype=bool),
        statistics=np.empty((room, kernels.GROUP_COLUMNS)),
        duplicate_of=np.empty(len(rows), dtype=np.int64),
    )
    sizes_px = np.array([camera.size_px for camera in rig.cameras], dtype=np.float64)
    around = FrameContext(
        cameras=rig.packed[0],
        sizes_px=np.where(frame.recorded[:, None], sizes_px, 0.0),
        boxes_px=boxes(frame.keypoints_px),
        box_view=frame.view,
    )
    pixels = frame.keypoints_px[rows[:, None], core]
    grown = kernels.form_groups(sight, law, around, pixels, evidence, seeds, drafts)
    return GroupTable(drafts.members[:grown], drafts.swapped[:grown], drafts.statistics[:grown], drafts.duplicate_of)


def _duplicates(rows: np.ndarray, duplicate_of: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """Shape (duplicate, 2): rows that repeat a member, and the proposals, by the groups that became them."""
    again = np.flatnonzero(duplicate_of >= 0)
    order = np.argsort(taken)
    person = order[np.searchsorted(taken[order], duplicate_of[again])]
    return np.stack([rows[again], person], axis=1)


def boxes(keypoints_px: np.ndarray) -> np.ndarray:
    """Shape (row, 4): least u, v and greatest u, v of each detection's keypoints, px; NaN where it has none."""
    return np.concatenate([np.fmin.reduce(keypoints_px, axis=1), np.fmax.reduce(keypoints_px, axis=1)], axis=1)
