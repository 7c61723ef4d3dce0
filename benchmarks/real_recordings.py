"""Report the share of rejected observations per camera, and reprojection errors, of real recordings.

``python -m benchmarks.real_recordings FOLDER``, where FOLDER holds the recordings that the tests read.
"""

import argparse
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import posefuse
from posefuse.model.cameras import Camera, CameraRig, LensModel
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import ViewStatus
from posefuse.skeleton.skeletons import Skeleton

FLY_SEED = "rng=0.csv"


def pose2sim(folder: Path) -> tuple[CameraRig, Detections]:
    """Read one balancing person, OpenPose."""
    rig = posefuse.read_cameras(folder / "pose2sim" / "calibration" / "Calib.qca.txt")
    return rig, posefuse.read_detections(folder / "pose2sim" / "balancing_one_person" / "pose-associated")


def fly_3cam(folder: Path) -> tuple[CameraRig, Detections]:
    """Read a tethered fly in front of telephoto lenses, DeepLabCut."""
    from posefuse.io.keypoints.columns import ViewColumns, assemble
    from posefuse.skeleton.from_names import skeleton_of

    rig = posefuse.read_cameras(folder / "fly_3cam" / "calibration.toml", length_unit="mm")
    views = []
    for camera in rig.names:
        (file,) = (folder / "fly_3cam").glob(f"*{camera}*{FLY_SEED}")
        one = posefuse.read_detections(file)
        keypoints = np.concatenate([one.keypoints_px, np.asarray(one.confidence)[..., None]], axis=-1)
        frames = np.asarray(one.frame_numbers)
        views.append(ViewColumns(camera, frames, frames, keypoints, np.zeros(len(frames), dtype=np.int64)))
    return rig, assemble(folder, views, skeleton_of("fly", one.skeleton.keypoints), None)


def deepfly_7cam(folder: Path) -> tuple[CameraRig, Detections]:
    """Read a tethered fly, 19 points per side; each camera sees one side, and the front camera has unusable points."""
    with np.load(folder / "deepfly_7cam" / "deepfly_7cam.npz") as held:
        content = {name: held[name] for name in held.files}
    cameras = []
    for v, (rotation, translation) in enumerate(zip(content["R"], content["tvec"], strict=True)):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, translation
        lens = tuple(float(k) for k in content["dist"][v])
        model = LensModel.BROWN if any(lens) else LensModel.PINHOLE
        cameras.append(Camera(f"camera_{v}", (960, 480), content["K"][v], pose, model, lens if any(lens) else ()))
    pixels = np.moveaxis(content["points2d_px"], 0, 1)
    pixels = np.where((pixels == 0).all(axis=-1, keepdims=True), np.nan, pixels)
    names = tuple(f"{side}_{i}" for side in ("left", "right") for i in range(19))
    rig = CameraRig(tuple(cameras))
    return rig, Detections.from_dense(Skeleton("deepfly", names), rig.names, pixels)


def sleap_mouse(folder: Path, calibration: str = "calibration_0b26179_good.toml") -> tuple[CameraRig, Detections]:
    """Read a mouse, SLEAP."""
    rig = posefuse.read_cameras(folder / "sleap_mouse" / calibration, length_unit="mm")
    return rig, posefuse.read_detections(folder / "sleap_mouse")


def recordings(folder: Path) -> Iterator[tuple[str, CameraRig, Detections]]:
    """Yield the name, rig and detections of every recording."""
    yield "pose2sim", *pose2sim(folder)
    yield "fly_3cam", *fly_3cam(folder)
    yield "deepfly_7cam", *deepfly_7cam(folder)
    yield "sleap_mouse", *sleap_mouse(folder)
    yield "sleap_mouse, faulty calibration", *sleap_mouse(folder, "calibration.toml")


def rejected_shares(result: Reconstruction) -> dict[str, float]:
    """Return the share of rejected observations, of those used or rejected, by camera."""
    status = np.asarray(result.layers["measured"].view_status)
    rejected = (status == ViewStatus.OUTLIER).sum(axis=(0, 1, 2))
    used = (status == ViewStatus.USED).sum(axis=(0, 1, 2))
    shares = rejected / np.maximum(rejected + used, 1)
    return dict(zip(result.rig.names, shares.tolist(), strict=True))


def main() -> None:
    """Print the table of docs/benchmarks.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    print("| recording | rejected, by camera | points missing | median error | noise |\n|---|---|---|---|---|")
    for name, rig, detections in recordings(folder):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            result = posefuse.reconstruct(rig, detections, Options(solve="frame"))
        layer = result.layers["measured"]
        shares = ", ".join(f"{camera} {100 * share:.1f} %" for camera, share in rejected_shares(result).items())
        noise = result.noise
        assert noise is not None
        print(
            f"| {name} | {shares} | {100 * (~layer.has_point).mean():.1f} % | "
            f"{np.nanmedian(layer.reprojection_error_px):.2f} px | {np.median(noise.scale_px):.2f} px |"
        )
        for warning in caught:
            print(f"|   warning: | {warning.message} | | | |")


if __name__ == "__main__":
    main()
