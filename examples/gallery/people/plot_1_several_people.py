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
figure, axes = plt.subplots()
for person, name in enumerate(result.person_ids):
    center = np.nanmedian(layer.points_m[:, person], axis=1)
    print(f"{name}: {int(np.isfinite(center[:, 0]).sum())} of {result.n_frames} frames")
    axes.plot(center[:, 0], center[:, 1], label=name)
axes.set(xlabel="x (m)", ylabel="y (m)", title="Paths from above", aspect="equal")
axes.legend()

plt.show()
