"""Several people
==============

People are tracked with articulated bodies; each keeps a name over time.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse

scene = posefuse.simulate_crowd(posefuse.CrowdOptions(people=2, duration_s=3.0, seed=1))
result = posefuse.reconstruct(scene.rig, scene.detections)

_, layer = result.best_layer()
hip = result.skeleton.index("left_hip")
figure, axes = plt.subplots()
for person, name in enumerate(result.person_ids):
    path_m = layer.points_m[:, person, hip]
    print(f"{name}: {int(np.isfinite(path_m[:, 0]).sum())} of {result.n_frames} frames")
    axes.plot(path_m[:, 0], path_m[:, 1], label=name)
axes.set(xlabel="x (m)", ylabel="y (m)", title="Paths of the left hips from above", aspect="equal")
axes.legend()

plt.show()
