"""A user's script, which pyright checks in strict mode. It is not executed."""

import numpy as np

import posefuse

rig = posefuse.read_cameras("calibration.toml")
detections = posefuse.read_detections("keypoints")
result = posefuse.reconstruct(rig, detections, posefuse.Options(rate_hz=60.0))
for name, layer in result.layers.items():
    ok = layer.status == posefuse.PointStatus.OK
    print(name, 1000 * np.nanmean(layer.points_m[ok], axis=0))
    print(layer.sd_m.shape, layer.n_views.max(), layer.has_point.mean())
wrists = result.layers["measured"].points_m[:, 0, result.skeleton.keypoints.index("left_wrist")]
speed = np.linalg.norm(np.diff(wrists, axis=0), axis=-1) * (result.rate_hz or 1.0)
print(speed.max(), [finding.kind for finding in result.findings])
posefuse.write(result, "result")
again = posefuse.read_reconstruction("result/reconstruction.nc")
print((again.layers["measured"].points_m * 1000).shape, detections.keypoints_px.mean())
outcome = posefuse.reconstruct_recording("recording", "result")
print(outcome.files, outcome.open().person_ids)
tracker = posefuse.Tracker(rig, detections.skeleton)
