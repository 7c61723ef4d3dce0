"""A stand-in for the calibration of a single camera, whose keypoints stay in its image plane."""

import math
from collections.abc import Sequence

import numpy as np

from posefuse.errors import CameraError
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.detections import Detections


def uncalibrated_camera(detections: Detections, image_size_px: Sequence[int] = ()) -> CameraRig:
    """Return a rig of one camera without calibration, named after the only view.

    Its matrix and pose are placeholders, which the result in its image plane does not depend on: the focal length is
    the longer side of the image, and the camera is at the origin.

    Args:
        detections: detections of one view.
        image_size_px: width and height of the images; by default the smallest image that contains the keypoints.

    Raises:
        CameraError: if there are several views.
    """
    if detections.n_views != 1:
        raise CameraError(f"{detections.n_views} views need a calibration; only a single view needs none.")
    source = "given" if image_size_px else "that of the smallest image with all keypoints"
    width, height = image_size_px or _smallest_image(detections)
    focal_px = float(max(width, height))
    matrix = np.array([[focal_px, 0.0, 0.5 * (width - 1)], [0.0, focal_px, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    (name,) = detections.view_names
    note = (
        f"{name} has no calibration: its keypoints are placed in its image plane, in pixels. The image size is "
        f"{source} ({width} x {height} px); the stored focal length is a placeholder."
    )
    return CameraRig((Camera(name, (width, height), matrix, np.eye(4)),), notes=(note,), calibrated=False)


def _smallest_image(detections: Detections) -> tuple[int, int]:
    largest = np.zeros(2)
    for chunk in detections.chunks():
        pixels = np.asarray(chunk.keypoints_px).reshape(-1, 2)
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        if len(pixels):
            largest = np.maximum(largest, pixels.max(axis=0))
    width, height = (max(1, math.ceil(value)) + 1 for value in largest)
    return width, height
