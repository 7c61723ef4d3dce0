"""What each format is known by, in words: what its reader looks at before it says that a file is its own."""

from posefuse.io.formats import Format

_CALIBRATIONS = {
    "caliscope": "tables of cameras with port or cam_id, in one TOML file",
    "pose2sim": "a table a camera, named after it, in TOML",
    "anipose": "tables cam_0, cam_1, ... with name, matrix, rotation, in TOML",
    "qualisys": "XML of cameras with fov_video and transform",
    "vicon": "XML of cameras with key frames",
    "easymocap": "intri.yml beside extri.yml",
    "opencap": "cameraIntrinsicsExtrinsics.pickle in a folder a camera",
    "mc_dev": "*.calib of 32 numbers",
    "panoptic": "JSON of cameras with K, R, t, distCoef",
    "acinoset": "JSON with camera_resolution",
    "scene": "JSON of a scene with extrinsics",
    "association4d": "JSON of cameras with K, RT, imgSize",
    "kalibr": "YAML of cam0, cam1, ... with camera_model",
    "label3d": "MATLAB variable params",
    "parameter_table": "parquet columns R, T or rvec",
    "mvor": "JSON with cameras_info.camParams",
    "arrays": "arrays K, R, t in an .npz",
    "opencv": "FileStorage matrices, a file or two a camera",
    "projections": "matrices of 3 x 4 numbers",
}

_KEYPOINTS = {
    "posefuse": "netCDF-4 marked as posefuse's keypoints",
    "freemocap": "output_data/raw_data/*2dData*.npy",
    "openpose": 'a folder a camera, JSON files with "people", numbered',
    "easymocap": 'a folder a camera, JSON files with "annots", numbered',
    "opencap": "OutputPkl*/<trial>/*_pp.pkl in a folder a camera",
    "mmpose": 'JSON with "instances" of each frame',
    "alphapose": "JSON list with image_id as a file's name, and keypoints",
    "mvor": "JSON with multiview_images, or coco_keypoints",
    "coco": "JSON with image_id or images, and keypoints",
    "label3d": "MATLAB variable labelData",
    "deeplabcut": "header rows scorer, (individuals,) bodyparts, coords",
    "caliscope": "columns sync_index, port (cam_id), frame_time, point_id, img_loc_x, img_loc_y",
    "sleap": "HDF5 with tracks and node_names",
    "deepfly": "array points2d of (camera, frame, 38, 2) in an .npz",
    "arrays": "NumPy array, its axes taken as camera, frame, keypoint",
}


def known_by(form: Format) -> str:
    """What a file was recognised by."""
    told = _CALIBRATIONS if "calibration" in form.module else _KEYPOINTS
    return told.get(form.name, form.files)
