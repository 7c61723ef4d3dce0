"""What rigs and detections state about themselves, as methods of these classes."""

from importlib import import_module
from typing import Any

from posefuse.described import Description, count, names


def describe_rig(rig: Any) -> Description:
    """Return the number of cameras, their names, images and lenses, and the up axis."""
    sizes = dict.fromkeys(f"{camera.size_px[0]} x {camera.size_px[1]} px" for camera in rig.cameras)
    lenses = dict.fromkeys(camera.lens.value for camera in rig.cameras)
    return Description(
        f"CameraRig: {count(len(rig), 'camera')}",
        (
            ("cameras", names(rig.names)),
            ("images", names(tuple(sizes))),
            ("lenses", names(tuple(lenses))),
            ("up axis", rig.up_text),
            ("file", rig.source or "none"),
        ),
    )


def plot_rig(rig: Any) -> Any:
    """Return a matplotlib figure of the cameras' positions and directions."""
    # Loaded on first use: cameras do not depend on figures.
    return import_module("posefuse.pipeline.notebook").plot_rig(rig)


def describe_detections(detections: Any) -> Description:
    """Return the numbers of frames, views and detections, the skeleton and the names of the views."""
    rate = f" at {detections.rate_hz:g} Hz" if detections.rate_hz else ""
    return Description(
        f"Detections: {count(detections.n_frames, 'frame')}{rate}, {count(detections.n_views, 'view')}",
        (
            ("skeleton", f"{detections.skeleton.name}, {count(len(detections.skeleton), 'keypoint')}"),
            ("views", names(detections.view_names)),
            ("detections", str(int(detections.offsets[-1]))),
        ),
    )
