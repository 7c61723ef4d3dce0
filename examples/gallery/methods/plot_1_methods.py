"""Compare triangulation methods
=============================

All methods run on the same detections; the median error is known because the recording is simulated.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))

truth = scene.truth.layers["measured"].points_m
median_mm = {}
for method in ("consensus", "simple", "ransac", "irls", "midpoint"):
    options = posefuse.Options(triangulation=posefuse.TriangulationOptions(method=method), solve="frame", health="off")
    points = posefuse.reconstruct(scene.rig, scene.detections, options).layers["measured"].points_m
    distance_mm = 1000 * np.linalg.norm(points - truth, axis=-1)
    median_mm[method] = float(np.nanmedian(distance_mm))
    print(f"{method:10} median {median_mm[method]:.0f} mm, 95th percentile {np.nanpercentile(distance_mm, 95):.0f} mm")

figure, axes = plt.subplots()
axes.barh(list(median_mm), list(median_mm.values()))
axes.set(xlabel="median error (mm)", title="Triangulation methods")

plt.show()
