"""Measure time offsets
====================

Cameras that started at different times are synchronized by the motion of the person.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse
from posefuse.synthetic.options import DetectorOptions

detector = DetectorOptions("rtmpose", max_offset_s=0.2)
scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=6.0, seed=1, detector=detector))

timings, sync = posefuse.measure_sync(scene.rig, scene.detections)
estimated = dict(zip(sync.cameras, sync.offset_s, strict=True))
true_s = scene.offsets_s - scene.offsets_s[0]
measured_s = np.array([estimated.get(name, 0.0) for name in scene.rig.names])
measured_s -= measured_s[0]
for name, true, measured in zip(scene.rig.names, true_s, measured_s, strict=True):
    print(f"{name}: true {true:+.3f} s, measured {measured:+.3f} s")

figure, axes = plt.subplots()
axes.plot(true_s, measured_s, "o")
axes.axline((0, 0), slope=1, color="0.7", zorder=0)
axes.set(xlabel="true offset (s)", ylabel="measured offset (s)", title="Time offset of each view", aspect="equal")

plt.show()
