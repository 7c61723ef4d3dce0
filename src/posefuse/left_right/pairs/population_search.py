"""Triangulate both points of a pair as in the specification: a four-term objective minimized by a population search.

The center is the robust intersection of all rays; e0 pushes the points apart, e1 pulls them to the rays (at most one
ray of a view each), e2 makes them equally distant from the center, and e3 puts the center between them. Nothing is
rejected, and fewer than four rays give no points. Source: the specification "Sparse Pose Fusion".
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.cameras.lens import OK
from posefuse.kernels.left_right.pairs import solve_pairs
from posefuse.kernels.left_right.population_search import search_pairs
from posefuse.kernels.left_right.records import PairParameters, PopulationSearch
from posefuse.kernels.records import NoiseParameters
from posefuse.kernels.triangulation.pair_order import ordered_pairs
from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.pairs import PairOptions
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.status import PointStatus
from posefuse.model.tracks import Tracks
from posefuse.triangulation.results import observations_of

_MM = 1000.0
# Every ray belongs to a point, regardless of its distance.
_MAX_RAY_DISTANCE_SIGMA = 1e6


def solve(
    rig: CameraRig,
    detections: Detections,
    tracks: Tracks,
    noise: NoiseModel,
    options: TriangulationOptions,
    pairs: Sequence[tuple[int, int]] | np.ndarray,
    pair_options: PairOptions | None = None,
) -> SolvedPairs:
    """Solve every pair of keypoints of every person in a range of frames.

    Args:
        rig: the cameras, in the order of the detections' views.
        detections: in memory. Random numbers depend on the frame number, not on where a range begins.
        tracks: assignment of detections to people, for the same frames.
        noise: error model of the detections, for the covariances, which are those of the rays each point rests on. The
            search does not use it.
        options: ``min_confidence`` and ``consensus`` (for the evidence) are used.
        pairs: shape (pair, 2): keypoint indices, left and right.
        pair_options: ``seed`` and ``sds`` are used.
    """
    pair_table = np.ascontiguousarray(np.asarray(pairs, dtype=np.int64).reshape(-1, 2))
    observations = observations_of(tracks, detections)
    rows = observations.detection_rows
    directions = rays_of(rig, detections, rows, pair_table, options.min_confidence)
    pair_options = pair_options or PairOptions()
    terms = pair_options.sds
    couples = np.empty((directions.shape[0] * len(pair_table), 6))
    costs = np.empty(len(couples))
    search_pairs(
        _MM * np.stack([camera.center_m for camera in rig.cameras]),
        directions.reshape(len(couples), len(rig), 2, 3),
        PopulationSearch(
            np.array([terms.separation_weight, terms.ray_weight, terms.equidistance_weight, terms.opposite_weight]),
            terms.separation_mm,
            terms.jitter_mm,
            terms.tolerance_mm,
            terms.max_iterations,
            terms.agents,
            pair_options.seed,
        ),
        int(detections.frame_numbers[0]) * len(tracks.person_ids) * len(pair_table),
        couples,
        costs,
    )
    out = SolvedPairs.allocate(len(rows), len(pair_table), len(rig))
    solve_pairs(
        rig.packed,
        observations,
        NoiseParameters(noise.scale_px, noise.exponent, options.min_confidence),
        PairParameters(
            frozen(pair_table, np.int64),
            ordered_pairs(len(rig)),
            2,
            options.consensus.full_weight_sigma,
            _MAX_RAY_DISTANCE_SIGMA,
            np.inf,
        ),
        np.full((len(tracks.person_ids), len(pair_table), 6), np.nan),
        couples.reshape(len(rows), len(pair_table), 6) / _MM,
        out.arrays,
    )
    rays = np.isfinite(directions).all(axis=-1).sum(axis=(-1, -2))
    out.status[(rays > 0) & (rays < 4)] = PointStatus.TOO_FEW_VIEWS
    max_evidence = 2.0 * (options.consensus.zero_weight_sigma**2 + 2.0 * options.consensus.full_weight_sigma**2) / 3.0
    np.clip(out.evidence, -max_evidence, max_evidence, out=out.evidence)
    return replace(out, cost=costs.reshape(out.cost.shape)).finish(tracks)


def rays_of(
    rig: CameraRig, detections: Detections, rows: np.ndarray, pairs: np.ndarray, min_confidence: float
) -> np.ndarray:
    """Return unit vectors of the rays of both labels, shape (person_frame, pair, view, 2, 3); NaN where invalid."""
    out = np.full((len(rows), len(pairs), len(rig), 2, 3), np.nan)
    keypoints, confidence = frozen(detections.keypoints_px), frozen(detections.confidence)
    for v, camera in enumerate(rig.cameras):
        detected = np.flatnonzero(rows[:, v] >= 0)
        pixels = keypoints[rows[detected, v]][:, pairs]
        directions, codes = camera.rays(pixels)
        # A NaN confidence is not low: the detector gives none.
        valid = (codes == OK) & ~(confidence[rows[detected, v]][:, pairs] < min_confidence)
        out[detected, :, v] = np.where(valid[..., None], directions @ camera.rotation, np.nan)
    return out
