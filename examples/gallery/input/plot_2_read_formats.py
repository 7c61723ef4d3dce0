"""Read files of other programs
============================

Write a calibration and 2D keypoints, and read them back: the format is recognized from the content.
"""

from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))

folder = Path(mkdtemp())
result = posefuse.reconstruct(scene.rig, scene.detections)
posefuse.write(result, folder / "keypoints.csv")
posefuse.write(result, folder / "person.trc")
for name in ("keypoints.csv", "person.trc"):
    points = posefuse.read_points(folder / name)
    print(f"{name:13} {len(points.frame_numbers)} frames, {len(points.keypoints)} keypoints, unit {points.unit!r}")
points_m = points.points_m[:, 0]

figure, axes = plt.subplots()
axes.plot(points.time_s, np.nanmax(points_m, axis=1)[:, 2])
axes.set(xlabel="time (s)", ylabel="height (m)", title="Highest keypoint of the TRC file")

plt.show()
