"""Layers of a result
==================

A result holds points of single frames (measured) and points estimated from all frames together (solved).
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))
result = posefuse.reconstruct(scene.rig, scene.detections)

name, _ = result.best_layer()
print(f"best layer: {name}")
truth = scene.truth.layers["measured"].points_m
names, errors = [], []
for name, layer in result.layers.items():
    distance_mm = 1000 * np.linalg.norm(layer.points_m - truth, axis=-1)
    print(f"{name:9} median error {np.nanmedian(distance_mm):.0f} mm")
    names.append(name)
    errors.append(distance_mm[np.isfinite(distance_mm)])

figure, axes = plt.subplots()
axes.boxplot(errors, tick_labels=names, showfliers=False)
axes.set(ylabel="error (mm)", title="Error of every point, by layer")

plt.show()
