"""Fill gaps and smooth
====================

Solved points are interpolated over short gaps and low-pass filtered on request.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))

processing = posefuse.PostprocessOptions(fill="pchip", max_gap_s=0.3, smooth=("hampel", "butterworth"))
options = posefuse.Options(solve="frame", postprocess=processing)
result = posefuse.reconstruct(scene.rig, scene.detections, options)
k = result.skeleton.index("right_ankle")

figure, axes = plt.subplots()
for name, style in (("measured", "."), ("solved", "-")):
    points = result.layers[name].points_m[:, 0, k]
    print(f"{name:9} {int(np.isfinite(points[:, 0]).sum())} of {len(points)} frames")
    axes.plot(result.time_s, points[:, 2], style, label=name)
axes.set(xlabel="time (s)", ylabel="z (m)", title="Right ankle")
axes.legend()

plt.show()
