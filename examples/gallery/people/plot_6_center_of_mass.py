"""Center of mass
==============

The center of mass, its velocity and their standard deviations.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))
result = posefuse.reconstruct(scene.rig, scene.detections)

mass = posefuse.center_of_mass(result)
speed = np.linalg.norm(mass.velocity_m_s[:, 0], axis=-1)
print(f"median speed {np.nanmedian(speed):.2f} m/s")

figure, (top, bottom) = plt.subplots(2, sharex=True)
top.plot(result.time_s, mass.xyz_m[:, 0, 2])
top.set(ylabel="height (m)", title="Center of mass")
bottom.plot(result.time_s, speed)
bottom.set(xlabel="time (s)", ylabel="speed (m/s)")

plt.show()
