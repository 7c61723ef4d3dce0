"""aniposelib's triangulate on a folder's calibration.toml and points.npy; prints its figures as JSON."""

import json
import statistics
import sys
import time
from pathlib import Path

import numpy as np
from aniposelib.cameras import CameraGroup

folder = Path(sys.argv[1])
points = np.load(folder / "points.npy")
cameras, frames, keypoints, _ = points.shape
group = CameraGroup.load(str(folder / "calibration.toml"))
flat = points.reshape(cameras, frames * keypoints, 2)
found = group.triangulate(flat)
times = []
for _ in range(3):
    start = time.process_time()
    found = group.triangulate(flat)
    times.append(time.process_time() - start)
np.save(folder / "aniposelib.npy", np.asarray(found).reshape(frames, keypoints, 3))
print(json.dumps({"ms_per_frame": 1000 * statistics.median(times) / frames}))
