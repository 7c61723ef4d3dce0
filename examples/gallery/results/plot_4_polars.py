"""polars
======

The parquet file of a result opens in polars; nothing is parsed.
"""

from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import polars as pl

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))
result = posefuse.reconstruct(scene.rig, scene.detections)
folder = Path(mkdtemp())
posefuse.write(result, folder / "keypoints.parquet")
table = pl.read_parquet(folder / "keypoints.parquet")
print(f"{table.height} rows, columns {', '.join(table.columns[:6])}")
wrist = table.filter(pl.col("keypoint") == "left_wrist")

figure, axes = plt.subplots()
axes.plot(wrist["time_s"], wrist["z_m"])
axes.set(xlabel="time (s)", ylabel="z (m)", title="Left wrist")

plt.show()
