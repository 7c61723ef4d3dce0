"""Estimate the noise of a detector
================================

The standard deviation of each camera is estimated by leaving views out; no ground truth is needed.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))

noise = posefuse.calibrate_noise(scene.rig, scene.detections)
for name, scale in zip(scene.rig.names, noise.scale_px, strict=True):
    print(f"{name}: {scale:.1f} px at confidence 1")

confidence = np.linspace(0.2, 1.0, 50)
figure, axes = plt.subplots()
for name, scale in zip(scene.rig.names, noise.scale_px, strict=True):
    axes.plot(confidence, scale / confidence**noise.exponent, label=name)
axes.set(xlabel="confidence", ylabel="standard deviation (px)", title="Noise model", ylim=(0, None))
axes.legend()

plt.show()
