"""Dask
====

Reconstruct several recordings in parallel; a cluster takes the same call.
"""

import dask
import matplotlib.pyplot as plt
import numpy as np

import posefuse


@dask.delayed
def median_error_mm(seed: int) -> float:
    """Return the median error of a simulated recording."""
    scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=2.0, seed=seed))
    result = posefuse.reconstruct(scene.rig, scene.detections, posefuse.Options(health="off"))
    distance_m = np.linalg.norm(result.best_layer()[1].points_m - scene.truth.layers["measured"].points_m, axis=-1)
    return float(1000 * np.nanmedian(distance_m))


errors_mm = dask.compute(*[median_error_mm(seed) for seed in range(3)], scheduler="synchronous")
print(f"median errors: {', '.join(f'{error:.0f}' for error in errors_mm)} mm")

figure, axes = plt.subplots()
axes.bar(range(3), errors_mm)
axes.set(xlabel="recording", ylabel="median error (mm)", xticks=range(3), title="Three recordings")

plt.show()
