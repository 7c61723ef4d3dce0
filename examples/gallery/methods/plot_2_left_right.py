"""Left/right swaps
================

A detector that swaps left and right is corrected per limb and over time.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse
from posefuse.synthetic.options import DetectorOptions

detector = DetectorOptions("rtmpose", swap_share=0.05)
scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1, detector=detector))

corrected = posefuse.reconstruct(scene.rig, scene.detections)
trusting = posefuse.reconstruct(scene.rig, scene.detections, posefuse.Options(pairs="labels"))
truth = scene.truth.layers["measured"].points_m
k = corrected.skeleton.index("left_ankle")
figure, axes = plt.subplots()
for label, result in (("labels accepted", trusting), ("corrected", corrected)):
    distance_mm = 1000 * np.linalg.norm(result.layers["measured"].points_m - truth, axis=-1)[:, 0]
    print(f"{label:16} 95th percentile {np.nanpercentile(distance_mm, 95):.0f} mm")
    axes.plot(result.time_s, distance_mm[:, k], label=label)
axes.set(xlabel="time (s)", ylabel="error (mm)", title="Left ankle")
axes.legend()

plt.show()
