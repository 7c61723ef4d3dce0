"""Simulate and reconstruct
========================

Simulate a person, reconstruct it and compare the result with the truth.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=5, duration_s=4.0, seed=1))
result = posefuse.reconstruct(scene.rig, scene.detections)
measured = result.layers["measured"]

error_mm = 1000 * np.linalg.norm(measured.points_m[:, 0] - scene.truth.layers["measured"].points_m[:, 0], axis=-1)
sd_mm = 1000 * np.sqrt((measured.sd_m[:, 0] ** 2).sum(axis=-1))
for name in ("nose", "left_wrist", "right_ankle"):
    k = result.skeleton.index(name)
    error, sd = np.nanmedian(error_mm[:, k]), np.nanmedian(sd_mm[:, k])
    print(f"{name:12} error {error:.0f} mm, standard deviation {sd:.0f} mm")

posefuse.write(result, "person.trc", overwrite=True)
posefuse.write(result, "reconstruction.nc", overwrite=True)

time_s = result.time_s
k = result.skeleton.index("left_wrist")
figure, axes = plt.subplots()
axes.plot(time_s, error_mm[:, k], label="error")
axes.plot(time_s, sd_mm[:, k], label="standard deviation")
axes.set(xlabel="time (s)", ylabel="mm", title="Left wrist", ylim=(0, None))
axes.legend()
plt.show()
