"""pandas
======

The CSV table has one row per frame, person and keypoint.
"""

from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import pandas as pd

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))
result = posefuse.reconstruct(scene.rig, scene.detections)
folder = Path(mkdtemp())
posefuse.write(result, folder / "keypoints.csv")
table = pd.read_csv(folder / "keypoints.csv", comment="#")
print(table.head(3).to_string(na_rep="-"))
counts = table.groupby("keypoint")["n_views"].mean().sort_values()

figure, axes = plt.subplots()
axes.barh(counts.index, counts)
axes.tick_params(axis="y", labelsize=6)
axes.set(xlabel="mean number of views", title="Views per keypoint")

plt.show()
