"""Joint angles
============

Angles of people in the conventions of OpenSim, with 95 % intervals.
"""

import matplotlib.pyplot as plt

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))
result = posefuse.reconstruct(scene.rig, scene.detections)

angles = result.joint_angles
k = angles.names.index("knee_angle_r")
value, sd = angles.degrees[:, 0, k], angles.sd_deg[:, 0, k]
print(f"right knee: {value.min():.0f} to {value.max():.0f} degrees")

figure, axes = plt.subplots()
axes.fill_between(result.time_s, value - 1.96 * sd, value + 1.96 * sd, alpha=0.3)
axes.plot(result.time_s, value)
axes.set(xlabel="time (s)", ylabel="degrees", title="Right knee flexion")

plt.show()
