"""The formats there are: adding one is a file and a line here."""

from dataclasses import dataclass
from importlib import import_module
from types import ModuleType


@dataclass(frozen=True)
class Format:
    """One file format.

    Attributes:
        name: what ``--format`` and messages call it.
        module: where it is read or written.
        reads: whether there is a reader.
        writes: whether there is a writer.
        files: what the files are called.
        conventions: units and axes in a line.
        lacks: what of a result's layer it has no place for; empty where it holds everything.
        suits: what a file beside a result is called, where one can be asked for by ``--also``.
    """

    name: str
    module: str
    reads: bool
    writes: bool
    files: str
    conventions: str
    lacks: str = ""
    suits: str = ""

    def load(self) -> ModuleType:
        """The format's module."""
        return import_module(self.module)


CALIBRATIONS = (
    Format(
        "caliscope",
        "posefuse.io.calibration.caliscope",
        reads=True,
        writes=False,
        files="config.toml, camera_array.toml",
        conventions="metres, world to camera; Rodrigues vector or matrix; up unknown: --up",
    ),
    Format(
        "pose2sim",
        "posefuse.io.calibration.pose2sim",
        reads=True,
        writes=False,
        files="*.toml, a table a camera",
        conventions="metres, z up, world to camera, Rodrigues vector; distortion as written",
    ),
    Format(
        "anipose",
        "posefuse.io.calibration.anipose",
        reads=True,
        writes=True,
        files="*.toml, tables cam_0, cam_1, ... (also FreeMoCap)",
        conventions="the board's unit, often mm: --length-unit; up unknown: --up; world to camera, Rodrigues vector",
    ),
    Format(
        "qualisys",
        "posefuse.io.calibration.qualisys",
        reads=True,
        writes=False,
        files="*.qca.txt",
        conventions="mm, z up; intrinsics in 1/64 px; camera to world",
    ),
    Format(
        "vicon",
        "posefuse.io.calibration.vicon",
        reads=True,
        writes=False,
        files="*.xcp",
        conventions="mm, z up; quaternion world to camera; video cameras only",
    ),
    Format(
        "easymocap",
        "posefuse.io.calibration.easymocap",
        reads=True,
        writes=False,
        files="intri.yml and extri.yml, or their folder",
        conventions="metres, world to camera; up unknown: --up",
    ),
    Format(
        "opencap",
        "posefuse.io.calibration.opencap",
        reads=True,
        writes=False,
        files="*/cameraIntrinsicsExtrinsics.pickle, or their folder",
        conventions="mm, world to camera; up unknown: --up; nothing in it is run",
    ),
    Format(
        "mc_dev",
        "posefuse.io.calibration.mc_dev",
        reads=True,
        writes=False,
        files="*.calib, one a camera, or their folder",
        conventions="mm, world to camera; 32 numbers; up unknown: --up",
    ),
    Format(
        "panoptic",
        "posefuse.io.calibration.panoptic",
        reads=True,
        writes=False,
        files="calibration_*.json",
        conventions="cm, -y up, world to camera",
    ),
    Format(
        "acinoset",
        "posefuse.io.calibration.acinoset",
        reads=True,
        writes=False,
        files="*.json with camera_resolution",
        conventions="metres, fisheye, world to camera; up unknown: --up",
    ),
    Format(
        "scene",
        "posefuse.io.calibration.scene",
        reads=True,
        writes=False,
        files="scene.json",
        conventions="metres; extrinsic_format says which way; up unknown: --up",
    ),
    Format(
        "association4d",
        "posefuse.io.calibration.association4d",
        reads=True,
        writes=False,
        files="calibration.json of 4D Association",
        conventions="metres, world to camera; up unknown: --up",
    ),
    Format(
        "kalibr",
        "posefuse.io.calibration.kalibr",
        reads=True,
        writes=False,
        files="camchain*.yaml",
        conventions="metres, from the first camera or the IMU; up unknown: --up",
    ),
    Format(
        "label3d",
        "posefuse.io.calibration.label3d",
        reads=True,
        writes=False,
        files="*.mat with params (also DANNCE)",
        conventions="mm, K and R transposed; up unknown: --up",
    ),
    Format(
        "parameter_table",
        "posefuse.io.calibration.parameter_table",
        reads=True,
        writes=False,
        files="camera_params.parquet",
        conventions="metres, R T or rvec world to camera; up unknown: --up",
    ),
    Format(
        "mvor",
        "posefuse.io.calibration.mvor",
        reads=True,
        writes=False,
        files="camma_mvor_2018.json",
        conventions="mm, camera to first camera; rectified images, stored distortion not used; up unknown: --up",
    ),
    Format(
        "arrays",
        "posefuse.io.calibration.arrays",
        reads=True,
        writes=False,
        files="*.npz with K, R, t (or tvec), dist (also DeepFly3D)",
        conventions="world to camera; --length-unit; up unknown: --up",
    ),
    Format(
        "opencv",
        "posefuse.io.calibration.opencv",
        reads=True,
        writes=False,
        files="*.yml, *.yaml, *.xml, one or two a camera, or their folder (also JARVIS)",
        conventions="the board's unit: --length-unit; world to camera; up unknown: --up",
    ),
    Format(
        "projections",
        "posefuse.io.calibration.projections",
        reads=True,
        writes=False,
        files="*.npy (camera, 3, 4), or P_*.txt",
        conventions="P = K [R | t]; no lens distortion; --length-unit; up unknown: --up",
    ),
)

KEYPOINTS = (
    Format(
        "posefuse",
        "posefuse.io.keypoints.native",
        reads=True,
        writes=True,
        files="keypoints.nc",
        conventions="px, netCDF-4, any number of people, times, confidence, skeleton; lossless",
    ),
    Format(
        "openpose",
        "posefuse.io.keypoints.openpose",
        reads=True,
        writes=True,
        files="a folder a camera, a *.json a frame (also Pose2Sim, AlphaPose in OpenPose's layout)",
        conventions="px, x y confidence, 0 0 0 is missing; no frame rate: --rate-hz",
    ),
    Format(
        "tidy",
        "posefuse.io.keypoints.tidy",
        reads=True,
        writes=True,
        files="*.csv or *.parquet with camera, frame, keypoint, x_px, y_px",
        conventions="px, a row a keypoint, any number of people, times; parquet is lossless and read by ranges",
    ),
    Format(
        "replay",
        "posefuse.io.keypoints.replay",
        reads=True,
        writes=True,
        files="*.jsonl, a line a frame with each camera's detections",
        conventions="px, null is missing, frames without people stay; lossless",
    ),
    Format(
        "detection_tables",
        "posefuse.io.keypoints.detection_tables",
        reads=True,
        writes=True,
        files="a folder of *.parquet, one a camera, with frame_index, kps, kps_scores",
        conventions="px, a row a camera and frame, frames without people stay; read by ranges of frames",
    ),
    Format(
        "freemocap",
        "posefuse.io.keypoints.freemocap",
        reads=True,
        writes=False,
        files="a recording folder with output_data/raw_data/*2dData*.npy",
        conventions="px, [camera, frame, keypoint, 3], third channel depth, cameras in the order of the videos' names",
    ),
    Format(
        "easymocap",
        "posefuse.io.keypoints.easymocap",
        reads=True,
        writes=False,
        files="annots: a folder a camera, a *.json a frame (also ViTPose)",
        conventions="px, x y confidence, 0 0 is missing; no frame rate: --rate-hz",
    ),
    Format(
        "payloads",
        "posefuse.io.keypoints.payloads",
        reads=True,
        writes=False,
        files="*.jsonl or *.json of records, one a camera and time (ParaJumping, cvmmap)",
        conventions="px, COCO-WholeBody-133; frames by number, or by time",
    ),
    Format(
        "mmpose",
        "posefuse.io.keypoints.mmpose",
        reads=True,
        writes=False,
        files="a *.json a camera with instances (also RTMPose, rtmlib)",
        conventions="px; frames as numbered, from 1 or 0; no frame rate: --rate-hz",
    ),
    Format(
        "alphapose",
        "posefuse.io.keypoints.alphapose",
        reads=True,
        writes=False,
        files="an alphapose-results.json a camera",
        conventions="px, x y score; frames without people are not in it; --rate-hz",
    ),
    Format(
        "mvor",
        "posefuse.io.keypoints.mvor",
        reads=True,
        writes=False,
        files="openpose_kps.json beside camma_mvor_2018.json, or the latter",
        conventions="px; frames are triplets of images, 75 s apart; annotations have person ids; --rate-hz",
    ),
    Format(
        "coco",
        "posefuse.io.keypoints.coco",
        reads=True,
        writes=False,
        files="a *.json a camera: results, or annotations",
        conventions="px, x y score or visibility; no frame rate: --rate-hz",
    ),
    Format(
        "mediapipe",
        "posefuse.io.keypoints.mediapipe",
        reads=True,
        writes=False,
        files="a *.json or *.csv of landmarks a camera",
        conventions="shares of the image (--image-size, where the file does not say) or px; depth in px",
    ),
    Format(
        "label3d",
        "posefuse.io.keypoints.label3d",
        reads=True,
        writes=False,
        files="*.mat with labelData (also DANNCE)",
        conventions="px as in the calibration of the file; labels by hand, one animal; --rate-hz",
    ),
    Format(
        "deeplabcut",
        "posefuse.io.keypoints.deeplabcut",
        reads=True,
        writes=False,
        files="a folder of *.csv or *.h5, one a camera, of one animal or several (also EKS)",
        conventions="px, x y likelihood; cameras by what differs in the files' names; no frame rate: --rate-hz",
    ),
    Format(
        "caliscope",
        "posefuse.io.keypoints.caliscope",
        reads=True,
        writes=False,
        files="xy_*.csv",
        conventions="px, a row a point, all cameras in one file, one person, MediaPipe's body",
    ),
    Format(
        "sleap",
        "posefuse.io.keypoints.sleap",
        reads=True,
        writes=False,
        files="a folder of analysis *.h5, one a camera, or in a folder a camera",
        conventions="px, NaN is missing; cameras by folder or file name; no frame rate: --rate-hz",
    ),
    Format(
        "slp",
        "posefuse.io.keypoints.slp",
        reads=True,
        writes=False,
        files="*.slp, one of all cameras or one a camera",
        conventions="px, views are videos, tracks are identities; no frame rate: --rate-hz; extra: posefuse[sleap]",
    ),
    Format(
        "deepfly",
        "posefuse.io.keypoints.deepfly",
        reads=True,
        writes=False,
        files="*.npz with points2d_px (camera, frame, 38, 2)",
        conventions="px, 0 0 is missing, fly_38; cameras by place; no frame rate: --rate-hz",
    ),
    Format(
        "arrays",
        "posefuse.io.keypoints.arrays",
        reads=True,
        writes=False,
        files="*.npy, *.npz",
        conventions="px, [camera, frame, keypoint, 2 or 3]; --third-channel; no names: --camera-order; --rate-hz",
    ),
)

RESULTS = (
    Format(
        "netcdf",
        "posefuse.io.results.netcdf",
        reads=True,
        writes=True,
        files="reconstruction.nc",
        conventions="netCDF-4, metres, world axes, every layer and field; lossless",
    ),
    Format(
        "csv",
        "posefuse.io.results.csv",
        reads=True,
        writes=True,
        files="keypoints.csv (measured), solved.csv, model.csv; angles.csv, events.csv",
        conventions="tidy, a row a frame, person and keypoint; metres, world axes; missing is empty",
        lacks="covariances between the axes, and which views",
    ),
    Format(
        "trc",
        "posefuse.io.results.trc",
        reads=True,
        writes=True,
        files="<person>.trc",
        conventions="metres, y up where up is known; missing is an empty cell",
        lacks="status, errors, covariances, views",
    ),
    Format(
        "c3d",
        "posefuse.io.results.c3d",
        reads=False,
        writes=True,
        files="<person>.c3d",
        conventions="mm, world axes (X_SCREEN, Y_SCREEN say up); missing is residual -1; camera bits up to 7 views",
        lacks="status, reprojection errors, covariances between the axes",
    ),
    Format(
        "parquet",
        "posefuse.io.results.parquet",
        reads=True,
        writes=True,
        files="*.parquet",
        conventions="the tidy CSV's columns, covariances, views; metres, world axes; cameras, options in the metadata",
        suits="points.parquet",
    ),
    Format(
        "anipose",
        "posefuse.io.results.anipose",
        reads=True,
        writes=True,
        files="*.csv, one a person",
        conventions="metres, world axes, a row a frame; M and center lead to the calibration in its own unit",
        lacks="times, status, covariances, which views",
        suits="anipose.csv",
    ),
    Format(
        "deeplabcut",
        "posefuse.io.results.deeplabcut",
        reads=True,
        writes=True,
        files="*.h5 or *.csv in 3D, everybody in one",
        conventions="metres, world axes, x y z a body part, a row a frame; pandas' df_with_missing",
        lacks="times, status, errors, covariances, views in CSV",
        suits="points_dlc.h5",
    ),
    Format(
        "sleap",
        "posefuse.io.results.sleap",
        reads=True,
        writes=True,
        files="points3d.h5",
        conventions="metres, world axes, tracks (frame, track, node, 3), a row a frame; names and all else in a group",
        suits="points3d.h5",
    ),
    Format(
        "movement",
        "posefuse.io.results.movement",
        reads=True,
        writes=True,
        files="*.nc with position (time, space, keypoint, individual)",
        conventions="metres, world axes, seconds; confidence is there and NaN; movement before 0.17 has other names",
        suits="movement.nc",
    ),
    Format(
        "nwb",
        "posefuse.io.results.nwb",
        reads=True,
        writes=True,
        files="*.nwb (needs posefuse[nwb])",
        conventions="metres, world axes, seconds; MultiCameraPoseEstimation a person; session's start 1970: not known",
        suits="points.nwb",
    ),
    Format(
        "npz",
        "posefuse.io.results.npz",
        reads=True,
        writes=True,
        files="*.npz, one a person",
        conventions="FreeMoCap's arrays by name; mm, world axes, a row a frame",
        suits="points.npz",
    ),
    Format(
        "freemocap",
        "posefuse.io.results.freemocap",
        reads=True,
        writes=True,
        files="a folder a person with output_data/*.npy, *.csv",
        conventions="FreeMoCap's names and shapes; mm, world axes, a row a frame; all else in output_data/posefuse",
        suits="freemocap",
    ),
    Format(
        "bvh",
        "posefuse.io.results.bvh",
        reads=False,
        writes=True,
        files="<person>.bvh",
        conventions="cm, y up, rests facing z, arms out; angles z x y; fitted bodies; last pose held while away",
    ),
    Format(
        "gltf",
        "posefuse.io.results.gltf",
        reads=False,
        writes=True,
        files="<person>.glb (or .gltf)",
        conventions="metres, y up, rests facing z, arms out; skin and animation; fitted bodies; hidden while away",
    ),
    Format(
        "opensim",
        "posefuse.io.results.opensim",
        reads=False,
        writes=True,
        files="a folder: <person>.trc, <person>_scaling.xml, <person>_ik.xml, markers.xml",
        conventions="metres, y up; OpenSim's marker names, on the bodies of Rajagopal's model",
        suits="opensim",
    ),
    Format(
        "openpose",
        "posefuse.io.results.openpose",
        reads=False,
        writes=True,
        files="a folder: <camera>_json/<camera>_<frame>_keypoints.json",
        conventions="px of each camera, points projected through its lens; 0 0 0 is missing; to overlay",
        suits="openpose",
    ),
)


def by_name(formats: tuple[Format, ...], name: str) -> Format | None:
    """The format of that name, or None."""
    return next((form for form in formats if form.name == name), None)
