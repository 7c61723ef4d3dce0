"""Compare the errors of recordings with left/right swaps with original and with corrected labels.

``python -m benchmarks.left_right_correction``: the same person, cameras and errors, with and without swaps.
"""

import warnings
from dataclasses import replace

import numpy as np

from posefuse.model.options.options import Options, PairMethod
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.synthetic.options import DetectorOptions, SceneOptions
from posefuse.synthetic.scenes import Scene, simulate

CAMERAS = (3, 5, 8)
DURATION_S = 20.0
NOISES = {
    "white, 5 px": DetectorOptions("gaussian", 5.0, outlier_share=0.05, miss_share=0.05, swap_share=0.0),
    "as measured": replace(DetectorOptions(), swap_share=0.0),
}
SHARES = (0.0, 0.003, 0.25)


def errors_mm(scene: Scene, pairs: PairMethod) -> np.ndarray:
    """Return the errors of all paired keypoints; NaN if missing."""
    paired = scene.detections.skeleton.pair_indices.ravel()
    result = reconstruct(scene.rig, scene.detections, Options(pairs=pairs, solve="frame"))
    points, truth = (np.asarray(each.layers["measured"].points_m) for each in (result, scene.truth))
    return 1000.0 * np.linalg.norm(points - truth, axis=-1)[:, 0, paired]


def numbers(errors: np.ndarray) -> str:
    """Format the median and 95th percentile in mm, and the share of missing points."""
    return f"{np.nanmedian(errors):7.1f} {np.nanpercentile(errors, 95):6.0f} {100 * np.isnan(errors).mean():6.2f}"


def main() -> None:
    """Run the benchmark and print its results."""
    warnings.simplefilter("ignore")
    print("\nPaired keypoints: median mm, 95 % mm, missing %")
    print(f"{'noise, cameras, swaps, share':38}{'original labels':>21}  {'corrected':>21}")
    for name, detector in NOISES.items():
        for cameras in CAMERAS:
            for swaps in ("chain", "pair", "body"):
                for share in SHARES if swaps == "chain" else SHARES[2:]:
                    swapped = replace(detector, swap_share=share, swap_law=swaps)
                    scene = simulate(SceneOptions(cameras=cameras, duration_s=DURATION_S, detector=swapped))
                    original, corrected = (numbers(errors_mm(scene, pairs)) for pairs in ("labels", "enumerate"))
                    row = f"{name}, {cameras}, {swaps}, {100 * share:g} %"
                    print(f"{row:38}{original}  {corrected}", flush=True)


if __name__ == "__main__":
    main()
