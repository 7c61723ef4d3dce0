"""The calibration formats, in the order in which their readers are tried.

To add a format, add a module that defines ``FORMAT`` and its name here. Readers that accept less come first.
"""

from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.formats import FormatRegistry

CALIBRATIONS = FormatRegistry(
    CalibrationFormat,
    "posefuse.io.calibration",
    (
        "caliscope",
        "pose2sim",
        "anipose",
        "qualisys",
        "vicon",
        "easymocap",
        "opencap",
        "mc_dev",
        "panoptic",
        "acinoset",
        "scene",
        "association4d",
        "kalibr",
        "label3d",
        "parameter_table",
        "mvor",
        "arrays",
        "opencv",
        "projections",
    ),
)
