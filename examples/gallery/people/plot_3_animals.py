"""Animals
=======

Any skeleton works. Here, a simulated mouse of 8 cm with the keypoints of DANNCE, and a detector with errors of 1 px.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import posefuse

options = posefuse.SceneOptions(skeleton="mouse_22", size_m=0.08, cameras=5, duration_s=3.0, seed=1)
detector = replace(options.detector, noise="gaussian", sigma_px=1.0)
scene = posefuse.simulate(replace(options, detector=detector))

result = posefuse.reconstruct(scene.rig, scene.detections)
_, layer = result.best_layer()
error_mm = 1000 * np.linalg.norm(layer.points_m - scene.truth.layers["measured"].points_m, axis=-1)
print(f"median error {np.nanmedian(error_mm):.1f} mm")

points_mm = 1000 * layer.points_m[len(layer.points_m) // 2, 0]
figure, axes = plt.subplots()
for a, b in result.skeleton.edge_indices:
    axes.plot(points_mm[[a, b], 0], points_mm[[a, b], 2], "o-", color="C0")
axes.set(xlabel="x (mm)", ylabel="z (mm)", title="One frame from the side", aspect="equal")

plt.show()
