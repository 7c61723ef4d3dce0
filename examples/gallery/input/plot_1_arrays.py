"""Your own cameras and arrays
===========================

Reconstruct from cameras and detections of your own program: no files, any skeleton.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse

# A camera: OpenCV's K, distortion, and camera_from_world (x_cam = R x_world + t).
K = np.array([[900.0, 0.0, 639.5], [0.0, 900.0, 359.5], [0.0, 0.0, 1.0]])


def camera_at(name: str, degrees: float) -> posefuse.Camera:
    """Return a camera 4 m from the z axis, 1.5 m above the floor, that looks at a point 1 m above the origin.

    Z is up.
    """
    angle = np.radians(degrees)
    center = np.array([4 * np.cos(angle), 4 * np.sin(angle), 1.5])
    forward = np.array([0.0, 0.0, 1.0]) - center
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    camera_from_world = np.eye(4)
    camera_from_world[:3, :3] = rotation
    camera_from_world[:3, 3] = -rotation @ center
    return posefuse.Camera(name, (1280, 720), K, camera_from_world, posefuse.LensModel.BROWN, (-0.1, 0.02, 0, 0, 0))


rig = posefuse.CameraRig(tuple(camera_at(f"cam_{i}", 90 * i) for i in range(4)), up_axis="z")
skeleton = posefuse.Skeleton("pendulum", ("pivot", "bob"), (("pivot", "bob"),))

# True positions (frame, keypoint, xyz) and simulated detections (frame, view, keypoint, 2).
time_s = np.arange(100) / 50
swing = 0.5 * np.sin(2 * np.pi * 0.6 * time_s)
bob = np.stack([0.8 * np.sin(swing), 0 * swing, 1.5 - 0.8 * np.cos(swing)], axis=-1)
truth = np.stack([np.tile([0.0, 0.0, 1.5], (100, 1)), bob], axis=1)
pixels = rig.project(truth) + np.random.default_rng(0).normal(0, 1.5, (100, 4, 2, 2))
pixels[20:30, 0] = np.nan  # missing is NaN

detections = posefuse.Detections.from_dense(skeleton, rig.names, pixels, rate_hz=50)
result = posefuse.reconstruct(rig, detections)
layer = result.layers["measured"]
print(f"noise of a detection: {result.noise.scale_px[0]:.2f} px (simulated: 1.50)")
print(f"views used in frame 25: {layer.n_views[25, 0].tolist()}")
print(f"median error: {1000 * np.median(np.linalg.norm(layer.points_m[:, 0] - truth, axis=-1)):.1f} mm")

figure, axes = plt.subplots()
axes.plot(truth[:, 1, 0], truth[:, 1, 2], color="0.7", linewidth=4, label="truth")
axes.plot(layer.points_m[:, 0, 1, 0], layer.points_m[:, 0, 1, 2], ".", label="measured")
axes.set(xlabel="x (m)", ylabel="z (m)", title="Bob of the pendulum", aspect="equal")
axes.legend()
plt.show()
