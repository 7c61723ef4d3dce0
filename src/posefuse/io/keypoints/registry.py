"""The formats of 2D keypoints, in the order in which their readers are tried.

To add a format, add a module that defines ``FORMAT`` and its name here. Readers that accept less come first.
"""

from posefuse.io.formats import FormatRegistry
from posefuse.io.keypoints.format import KeypointFormat

KEYPOINTS = FormatRegistry(
    KeypointFormat,
    "posefuse.io.keypoints",
    (
        "native",
        "openpose",
        "tidy",
        "replay",
        "detection_tables",
        "freemocap",
        "opencap",
        "easymocap",
        "payloads",
        "mmpose",
        "alphapose",
        "mvor",
        "coco",
        "mediapipe",
        "label3d",
        "deeplabcut",
        "caliscope",
        "sleap",
        "slp",
        "deepfly",
        "arrays",
    ),
)
