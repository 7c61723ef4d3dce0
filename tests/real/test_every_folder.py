"""Every folder of real recordings: read by its own format, and right by what reprojects.

Reprojection medians are of plain linear triangulation, as the data's notes have them; a reading with a wrong
convention misses them by far more than the tenth that is allowed here.
"""

import numpy as np
import pytest
from benchmarks import mvor

from posefuse import Options, read_cameras, read_detections
from posefuse.cli.main import main
from posefuse.model.cameras import CameraRig
from posefuse.preprocess.match_cameras import match_views

INSPECTED = {
    "caliscope_webcams": ("(caliscope)", "mediapipe_33", "30.37 Hz, following cam_0", "4 views match 4 cameras"),
    "dannce_mouse": ("(label3d)", "mouse_22", "frames 307 to 1876", "6 views match 6 cameras"),
    "deepfly_7cam": ("(arrays)", "(deepfly)", "fly_38", "7 views match 7 cameras"),
    "fly_3cam": ("(anipose)", "(deeplabcut)", "Cam-*_rot-ccw-0.06_sec.rng=2.csv'", "3 views match 3 cameras"),
    "mvor": ("(mvor)", "coco_17", "skeleton mvor, 10 keypoints", "3 views match 3 cameras"),
    "mouse_outdoor_12cam": ("(anipose)", "(arrays)", "skeleton point", "frames 0 to 176867"),
    "panoptic_motion": ("(panoptic)", "up axis -y", "no 2D keypoints", "Panoptic_GT_171026_pose3.npz: 3D results"),
    "panoptic_three_people": ("(panoptic)", "no 2D keypoints", "3D results"),
    "pose2sim": ("(qualisys)", "(pose2sim)", "(openpose)", "body_25b", "4 views match 4 cameras", ".trc", "settings"),
    "sleap_mouse": ("(anipose)", "(sleap)", "15 keypoints", "points3d.h5: 3D results", "4 views match 4 cameras"),
    "calibration_formats": ("(acinoset)", "(kalibr)", "(easymocap)", "intrinsics only"),
}


@pytest.mark.parametrize("name", INSPECTED)
def test_inspect_recognizes_the_format(name, shared_data, capsys):
    main(["inspect", str(shared_data(name)), "--verbose"])
    output = " ".join(capsys.readouterr().out.split())
    for words in INSPECTED[name]:
        assert words in output
    unread = output.count("cannot be read")
    # Two sets of lenses of Wildtrack's cameras are there, and are not chosen between.
    assert unread == (name == "calibration_formats")


def points_m(rig: CameraRig, pixels: np.ndarray) -> np.ndarray:
    """Shape (point, 3): plain linear triangulation, NaN below two views.

    Args:
        rig: the cameras.
        pixels: shape (point, view, 2), NaN where not seen.
    """
    visible = np.isfinite(pixels).all(axis=-1)
    rows = []
    for v, camera in enumerate(rig.cameras):
        rays = camera.rays(np.where(visible[:, v, None], pixels[:, v], 0.0))[0]
        plane = rays[:, :2] / rays[:, 2:]
        pose = camera.camera_from_world[:3]
        rows.append(np.where(visible[:, v, None, None], plane[:, :, None] * pose[2] - pose[:2], 0.0))
    enough = visible.sum(axis=1) >= 2
    actual = np.linalg.svd(np.concatenate(rows, axis=1)[enough])[2][:, -1]
    points = np.full((len(pixels), 3), np.nan)
    points[enough] = actual[:, :3] / actual[:, 3:]
    return points


def errors_px(rig: CameraRig, pixels: np.ndarray) -> np.ndarray:
    """Return reprojection errors, shape (point, view)."""
    return np.linalg.norm(rig.project(points_m(rig, pixels)) - pixels, axis=-1)


def read(calibration, keypoints, **options) -> tuple[CameraRig, np.ndarray]:
    """Cameras, and pixels (point, view, 2) of one subject."""
    rig = read_cameras(calibration)
    rig, detections, _ = match_views(rig, read_detections(keypoints), Options(**options))
    return rig, np.moveaxis(detections.dense()[0], 1, 2).reshape(-1, len(rig), 2)


def medians_px(calibration, keypoints, **options) -> np.ndarray:
    """Shape (view,)."""
    return np.nanmedian(errors_px(*read(calibration, keypoints, **options)), axis=0)


def within_a_tenth(actual: np.ndarray, least: float, most: float) -> None:
    """Of a range that the notes give over cameras."""
    assert np.min(actual) == pytest.approx(least, rel=0.1) or least <= np.min(actual) <= most
    assert np.max(actual) == pytest.approx(most, rel=0.1) or least <= np.max(actual) <= most


@pytest.mark.parametrize("calibration", ["Calib.qca.txt", "Calib_qualisys.toml"])
def test_pose2sim(calibration, shared_data):
    folder = shared_data("pose2sim")
    pixels = read(folder / "calibration" / calibration, folder / "balancing_one_person" / "pose-associated")
    assert np.nanmedian(errors_px(*pixels)) == pytest.approx(13, rel=0.1)


def test_caliscope(shared_data):
    folder = shared_data("caliscope_webcams")
    within_a_tenth(medians_px(folder / "config.toml", folder), 8, 18)


def test_mouse_with_two_calibrations(shared_data):
    """The notes' figure of the broken one is that of the wrong camera against the others."""
    folder = shared_data("sleap_mouse")
    within_a_tenth(medians_px(folder / "calibration_0b26179_good.toml", folder), 4, 9)
    rig, pixels = read(folder / "calibration.toml", folder)
    side = rig.index("side")
    others = np.where(np.arange(len(rig))[:, None] == side, np.nan, pixels)
    seen_from_side = rig.cameras[side].project(points_m(rig, others))[0]
    apart = np.linalg.norm(seen_from_side - pixels[:, side], axis=-1)
    assert np.nanmedian(apart) == pytest.approx(92, rel=0.1)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_fly_with_telephoto_lenses(seed, shared_data):
    folder = shared_data("fly_3cam")
    within_a_tenth(medians_px(folder / "calibration.toml", folder / f"*rng={seed}.csv"), 1.1, 1.9)


def test_fly_with_seven_cameras(shared_data):
    file = shared_data("deepfly_7cam") / "deepfly_7cam.npz"
    within_a_tenth(medians_px(file, file, exclude_camera=("3",)), 2.7, 3.8)


def test_projected_labels_reproject(shared_data):
    """The notes of the data state 0.1 to 0.9 px; with the correct lens model the errors vanish."""
    file = shared_data("dannce_mouse") / "label3d_demo.mat"
    assert medians_px(file, file).max() < 1e-6


def test_initial_calibration_of_twelve_cameras(shared_data):
    """Points that four cameras see, as bundle adjustment takes them."""
    folder = shared_data("mouse_outdoor_12cam")
    rig = read_cameras(folder / "calibration_right_4_10_2026_adjusted.toml")
    points = read_detections(folder / "points_right_4_10_2026_sub.npz")
    assert (points.n_frames, len(points.skeleton)) == (176_868, 1)
    pixels = np.asarray(points.keypoints_px).reshape(-1, 12, 2)
    several = np.flatnonzero(np.isfinite(pixels).all(axis=-1).sum(axis=1) >= 4)
    some = np.random.default_rng(0).choice(several, 6000, replace=False)
    assert np.nanmedian(errors_px(rig, pixels[some])) == pytest.approx(22, rel=0.1)


def test_operating_room(shared_data):
    """Manual labels are triangulated from all three views; detections are compared with the known positions."""
    folder = shared_data("mvor")
    rig = read_cameras(folder / "camma_mvor_2018.json")
    data = mvor.read_mvor(folder)
    by_hand = read_detections(folder / "camma_mvor_2018.json")
    assert (int(by_hand.offsets[-1]), by_hand.skeleton.keypoints) == (2926, mvor.JOINTS)  # of 4699, those with joints
    pixels = np.full((len(data.truth_m), 8, 3, 10, 2), np.nan)
    for f, of_frame in enumerate(data.annotated_px):
        for v, people in enumerate(of_frame):
            for person, joints in people.items():
                pixels[f, person, v] = joints
    flat = np.moveaxis(pixels, 2, 3).reshape(-1, 3, 2)
    whole = flat[np.isfinite(flat).all(axis=(1, 2))]
    assert 6 * 0.9 <= np.median(errors_px(rig, whole)) <= 7 * 1.1
    detected = read_detections(folder / "openpose_kps.json")
    assert (int(detected.offsets[-1]), detected.skeleton.name) == (4091, "coco_17")
    apart = []
    for f, truth in enumerate(data.truth_m):
        projected = rig.project(truth[None])[0] if len(truth) else np.empty((3, 0, 10, 2))
        for t, rows in enumerate(mvor.told_who(data, f)):
            for v in np.flatnonzero(rows >= 0):
                first = int(detected.offsets[3 * f + v])
                joints = mvor.to_joints(np.asarray(detected.keypoints_px)[first + rows[v]], detected.skeleton)
                apart.append(np.linalg.norm(projected[v, t] - joints, axis=-1))
    assert 10 * 0.9 <= np.nanmedian(apart) <= 12 * 1.1
