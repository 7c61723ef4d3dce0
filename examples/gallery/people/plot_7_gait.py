"""Gait
====

The steps of a person who walks, and the mean gait cycle of the right knee with one standard deviation.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse
from posefuse.pipeline.gait import analyze_gait

options = posefuse.SceneOptions(activities=("walk",), cameras=5, rate_hz=60.0, duration_s=6.0, seed=1)
scene = posefuse.simulate(options)
result = posefuse.reconstruct(scene.rig, scene.detections)

gait = analyze_gait(result)
print(*gait.summary())
cycle = next(each for each in gait.people["person_1"].cycles if (each.signal, each.side) == ("knee_angle_deg", "right"))

share = np.linspace(0, 100, len(cycle.mean))
figure, axes = plt.subplots()
axes.fill_between(share, cycle.mean - cycle.sd, cycle.mean + cycle.sd, alpha=0.3)
axes.plot(share, cycle.mean)
axes.set(xlabel="gait cycle (%)", ylabel="degrees", title=f"Right knee flexion, {cycle.n.max()} cycles")

plt.show()
