"""Why is a point missing?
=======================

Print the status of points and views: why a point is missing, and how each view was used.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import posefuse
from posefuse import PointStatus, TriangulationOptions, ViewStatus

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=2))
strict = posefuse.Options(triangulation=TriangulationOptions(min_views=4, min_confidence=0.4))
result = posefuse.reconstruct(scene.rig, scene.detections, strict)
layer = result.layers["measured"]

for code in PointStatus:
    count = int((layer.status == code).sum())
    if count:
        print(f"{count:6} points: {code.sentence}")

frame, person, keypoint = np.argwhere(layer.status == PointStatus.TOO_FEW_VIEWS)[0]
print(f"\nframe {frame}, {result.skeleton.keypoints[keypoint]}:")
for name, code in zip(result.rig.names, layer.view_status[frame, person, keypoint], strict=True):
    print(f"  {name}: {ViewStatus(code).sentence}")

# Accept points that only two views observe.
lenient = replace(strict, triangulation=replace(strict.triangulation, min_views=2))
more = posefuse.reconstruct(scene.rig, scene.detections, lenient).layers["measured"]
print(f"\nwith min_views = 2, {int((more.has_point & ~layer.has_point).sum())} more points have coordinates")

figure, axes = plt.subplots()
axes.imshow(layer.status[:, 0].T, aspect="auto", cmap="tab20", interpolation="nearest")
axes.set(xlabel="frame", yticks=range(len(result.skeleton)), title="Status of every point")
axes.set_yticklabels(result.skeleton.keypoints, fontsize=6)
plt.show()
