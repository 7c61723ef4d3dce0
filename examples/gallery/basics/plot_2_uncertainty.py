"""Uncertainty of points
=====================

Every point has a covariance. Here, the vertical position of a wrist with its 95 % interval.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))
result = posefuse.reconstruct(scene.rig, scene.detections)

layer = result.layers["measured"]
true_m = scene.truth.layers["measured"].points_m
known = np.isfinite(layer.points_m)
inside = np.abs(layer.points_m - true_m)[known] < 1.96 * layer.sd_m[known]
print(f"the 95 % intervals of {inside.size} coordinates cover the truth in {100 * inside.mean():.1f} %")

k = result.skeleton.index("right_wrist")
z, sd, truth = layer.points_m[:, 0, k, 2], layer.sd_m[:, 0, k, 2], true_m[:, 0, k, 2]

figure, axes = plt.subplots()
axes.fill_between(result.time_s, z - 1.96 * sd, z + 1.96 * sd, alpha=0.3, label="95 % interval")
axes.plot(result.time_s, z, label="measured")
axes.plot(result.time_s, truth, color="black", linewidth=0.8, label="truth")
axes.set(xlabel="time (s)", ylabel="z (m)", title="Right wrist")
axes.legend()

plt.show()
