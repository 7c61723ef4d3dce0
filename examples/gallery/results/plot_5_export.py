"""Export to other programs
========================

One call writes each format; the suffix decides.
"""

from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))
result = posefuse.reconstruct(scene.rig, scene.detections)
folder = Path(mkdtemp())
sizes = {}
for name in ("person.trc", "person.c3d", "keypoints.csv", "keypoints.parquet", "reconstruction.nc", "points.npz"):
    posefuse.write(result, folder / name)
    sizes[name] = sum(p.stat().st_size for p in folder.glob(f"*{Path(name).suffix}")) / 1024
    print(f"{name:18} {sizes[name]:.0f} kB")

figure, axes = plt.subplots()
axes.barh(list(sizes), list(sizes.values()))
axes.set(xlabel="kB", title="Size of three seconds")

plt.show()
