"""Draw a skeleton in 3D
=====================

The skeleton of one frame with matplotlib, and the cameras around it.
"""

import matplotlib.pyplot as plt

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))
result = posefuse.reconstruct(scene.rig, scene.detections)

_, layer = result.best_layer()
points = layer.points_m[45, 0]
print(f"{int(layer.has_point[45].sum())} of {len(points)} keypoints have coordinates")
figure = plt.figure(figsize=(6, 5))
axes = figure.add_subplot(projection="3d")
for a, b in result.skeleton.edge_indices:
    axes.plot(*points[[a, b]].T, color="C0")
for camera in result.rig.cameras:
    rotation, shift = camera.camera_from_world[:3, :3], camera.camera_from_world[:3, 3]
    axes.plot(*(-rotation.T @ shift)[:, None], "^", color="C1")
axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)", aspect="equal")

plt.show()
