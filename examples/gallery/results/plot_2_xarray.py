"""xarray
======

The netCDF file of a result opens as an xarray dataset.
"""

from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import xarray as xr

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=3.0, seed=1))
result = posefuse.reconstruct(scene.rig, scene.detections)
folder = Path(mkdtemp())
posefuse.write(result, folder / "reconstruction.nc")
tree = xr.open_datatree(folder / "reconstruction.nc", engine="h5netcdf")
print(f"{len(tree.groups)} groups: {', '.join(tree.groups[:6])}")
points = posefuse.read_reconstruction(folder / "reconstruction.nc").layers["measured"].points_m
axes_of_points = ("frame", "person", "keypoint", "xyz")
array = xr.DataArray(points[:], dims=axes_of_points, coords={"keypoint": list(result.skeleton.keypoints)})

figure, axes = plt.subplots()
axes.plot(array.sel(keypoint=["left_ankle", "right_ankle"]).isel(person=0, xyz=2))
axes.set(xlabel="frame", ylabel="z (m)", title="Ankles")

plt.show()
