"""Triangulate both points of a pair without trusting the labels, with each view in the state that explains it best.

Every two observations of two views propose a point. Couples of proposals that rest on different rays are scored by a
bounded reprojection cost, where every view is as labeled, swapped, partly used or unused, whichever costs least. The
best few are refined by reweighted Gauss-Newton over all views. See docs/methods.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.left_right.pairs import solve_pairs
from posefuse.kernels.left_right.records import PairParameters
from posefuse.kernels.records import NoiseParameters
from posefuse.kernels.triangulation.pair_order import ordered_pairs
from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.pairs import PairOptions
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.tracks import Tracks
from posefuse.triangulation.consensus import METHOD, reweighting_loss
from posefuse.triangulation.results import observations_of


def solve(
    rig: CameraRig,
    detections: Detections,
    tracks: Tracks,
    noise: NoiseModel,
    options: TriangulationOptions,
    pairs: Sequence[tuple[int, int]] | np.ndarray,
    pair_options: PairOptions | None = None,
    previous_m: np.ndarray | None = None,
) -> SolvedPairs:
    """Solve every pair of keypoints of every person in a range of frames.

    Args:
        rig: the cameras, in the order of the detections' views.
        detections: in memory.
        tracks: assignment of detections to people, for the same frames.
        noise: error model of the detections; views agree or disagree in units of it.
        options: ``min_views``, ``min_confidence`` and ``consensus`` are used.
        pairs: shape (pair, 2): keypoint indices, left and right.
        pair_options: ``motion_sd_m`` is used.
        previous_m: shape (person, pair, 2, 3): points of the frame before the first, NaN where unknown; on return,
            those of the last frame.
    """
    chosen = options.consensus
    pair_table = np.ascontiguousarray(np.asarray(pairs, dtype=np.int64).reshape(-1, 2))
    observations = observations_of(tracks, detections)
    people = len(tracks.person_ids)
    before = np.full((people, len(pair_table), 2, 3), np.nan) if previous_m is None else previous_m
    previous = np.array(before, dtype=np.float64).reshape(people, len(pair_table), 6)
    out = SolvedPairs.allocate(len(observations.detection_rows), len(pair_table), len(rig))
    solve_pairs(
        rig.packed,
        observations,
        NoiseParameters(noise.scale_px, noise.exponent, options.min_confidence),
        PairParameters(
            frozen(pair_table, np.int64),
            ordered_pairs(len(rig)),
            options.min_views or METHOD.default_min_views,
            chosen.full_weight_sigma,
            chosen.zero_weight_sigma,
            (pair_options or PairOptions()).motion_sd_m,
        ),
        previous,
        np.empty((0, len(pair_table), 6)),
        out.arrays,
    )
    if previous_m is not None:
        previous_m[:] = previous.reshape(previous_m.shape)
    variance_factor = reweighting_loss(chosen.full_weight_sigma, chosen.zero_weight_sigma)
    return replace(out, covariance_m2=out.covariance_m2 * variance_factor).finish(tracks)
