"""The formats of 3D results, in the order in which their readers are tried.

To add a format, add a module that defines ``FORMAT``, and add its name here. Stricter readers come first.
"""

from posefuse.io.formats import FormatRegistry
from posefuse.io.results.format import ResultFormat

RESULTS = FormatRegistry(
    ResultFormat,
    "posefuse.io.results",
    (
        "netcdf",
        "parquet",
        "anipose",
        "deeplabcut",
        "csv",
        "npz",
        "freemocap",
        "movement",
        "sleap",
        "nwb",
        "trc",
        "mot",
        "angles_wide",
        "c3d",
        "bvh",
        "gltf",
        "opensim",
        "openpose",
    ),
)
