"""Compare left/right correction of tracked people: none, in all frames, and where swaps are suspected.

``python -m benchmarks.suspected_swaps``: reports errors of paired keypoints of four walking people.
"""

import time
from dataclasses import replace

import numpy as np

from benchmarks.people import scene_of
from posefuse.left_right import relabel
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Layer
from posefuse.pipeline.reconstruct import prepare
from posefuse.progress import Silent
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.triangulation import consensus

SHARES = (0.003, 0.03, 0.15)
DURATION_S = 20.0
_MATCH_DISTANCE_M = 0.4


def numbers(layer: Layer, truth: np.ndarray, pairs: np.ndarray) -> str:
    """Format mean and 95th percentile in mm, and the share missing; people match by the nearest centers."""
    points = np.asarray(layer.points_m)
    away = np.linalg.norm(np.nanmean(points, axis=2)[:, :, None] - np.nanmean(truth, axis=2)[:, None], axis=-1)
    away = np.where(np.isnan(away), np.inf, away)
    matched = np.take_along_axis(truth, away.argmin(axis=2)[:, :, None, None], axis=1)
    errors = 1000.0 * np.linalg.norm(points - matched, axis=-1)[away.min(axis=2) < _MATCH_DISTANCE_M][:, pairs.ravel()]
    return f"{np.nanmean(errors):.1f}, {np.nanpercentile(errors, 95):.0f}, {100 * np.isnan(errors).mean():.2f} %"


def main() -> None:
    """Run the benchmark and print its table; ms are CPU time per frame."""
    print("| swapped | original labels: mean, 95 %, missing | corrected in all frames | where suspected | ms | ms |")
    print("|---|---|---|---|---|---|")
    for share in SHARES:
        crowd = CrowdOptions("crowd", seed=0, duration_s=DURATION_S)
        scene = scene_of(replace(crowd, detector=replace(crowd.detector, swap_share=share)))
        plan = prepare(scene.rig, scene.detections, Options(people="many"), Silent())
        inputs = plan.rig, plan.detections, plan.subjects.tracks(0, plan.detections.n_frames), plan.noise
        uncorrected = consensus.solve(*inputs, plan.options.triangulation)
        layers, spent = [uncorrected], []
        for solve, more in ((relabel.correct_swaps, (uncorrected,)), (relabel.solve, ())):
            solve(*inputs, plan.options, *more)
            start = time.process_time()
            layers.append(solve(*inputs, plan.options, *more)[0])
            spent.append(f"{1e3 * (time.process_time() - start) / plan.detections.n_frames:.2f}")
        truth = np.asarray(scene.truth.layers["measured"].points_m)
        cells = [numbers(layer, truth, plan.detections.skeleton.pair_indices) for layer in layers]
        print(f"| {100 * share:g} % | {' | '.join(cells)} | {' | '.join(spent)} |", flush=True)


if __name__ == "__main__":
    main()
