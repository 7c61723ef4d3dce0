"""Quality without ground truth
============================

Reprojection errors and the variation of bone lengths need no truth.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))
result = posefuse.reconstruct(scene.rig, scene.detections)

quality = posefuse.self_consistency(result)
print(f"median reprojection error {quality.reprojection_median_px:.1f} px")
print(f"variation of bone lengths {100 * quality.bone_variation:.1f} %")

error_px = result.layers["measured"].reprojection_error_px
figure, axes = plt.subplots()
axes.hist(error_px[np.isfinite(error_px)], bins=40)
axes.set(xlabel="reprojection error (px)", ylabel="points", title="Reprojection error of every point")

plt.show()
