"""How many cameras?
=================

Simulate the same motion with two to six cameras before you buy them.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse

numbers, errors_mm = (2, 3, 4, 5, 6), []
for number in numbers:
    scene = posefuse.simulate(posefuse.SceneOptions(cameras=number, duration_s=2.0, seed=1))
    result = posefuse.reconstruct(scene.rig, scene.detections, posefuse.Options(health="off"))
    _, layer = result.best_layer()
    distance_m = np.linalg.norm(layer.points_m - scene.truth.layers["measured"].points_m, axis=-1)
    errors_mm.append(1000 * np.nanmedian(distance_m))
    print(f"{number} cameras: median error {errors_mm[-1]:.0f} mm")

figure, axes = plt.subplots()
axes.plot(numbers, errors_mm, "o-")
axes.set(xlabel="cameras", ylabel="median error (mm)", title="Error by number of cameras", ylim=(0, None))

plt.show()
