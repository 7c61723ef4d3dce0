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
k = result.skeleton.index("right_wrist")
z, sd = layer.points_m[:, 0, k, 2], layer.sd_m[:, 0, k, 2]
truth = scene.truth.layers["measured"].points_m[:, 0, k, 2]
inside = np.abs(z - truth) < 1.96 * sd
print(f"the 95 % interval covers {100 * inside.sum() / np.isfinite(z).sum():.0f} % of the frames")

figure, axes = plt.subplots()
axes.fill_between(result.time_s, z - 1.96 * sd, z + 1.96 * sd, alpha=0.3, label="95 % interval")
axes.plot(result.time_s, z, label="measured")
axes.plot(result.time_s, truth, color="black", linewidth=0.8, label="truth")
axes.set(xlabel="time (s)", ylabel="z (m)", title="Right wrist")
axes.legend()

plt.show()
