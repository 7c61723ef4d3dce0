"""Writers of calibrations in the formats of other programs; each returns the path to read."""

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from posefuse.model.cameras import Camera, CameraRig, LensModel, vector_from_rotation
from tests.files import anipose_toml, pose2sim_toml, qualisys_xml
from tests.scenes import ring


def coefficients(camera: Camera) -> list[float]:
    """Five of OpenCV's, or a fisheye's four."""
    return list(camera.distortion) or [0.0] * 5


def caliscope_old(rig: CameraRig, folder: Path) -> Path:
    tables = [
        f"[cam_{i}]\nport = {i}\nsize = {list(c.size_px)}\nrotation_count = 1\nmatrix = {c.matrix.tolist()}\n"
        f"distortions = {coefficients(c)}\ntranslation = {c.translation_m.tolist()}\nrotation = {c.rotation.tolist()}\n"
        "ignore = false\n"
        for i, c in enumerate(rig.cameras)
    ]
    return _text(folder / "config.toml", "\n".join(tables))


def caliscope_new(rig: CameraRig, folder: Path) -> Path:
    tables = [
        f"[cameras.{i}]\ncam_id = {i}\nsize = {list(c.size_px)}\nrotation_count = 0\nmatrix = {c.matrix.tolist()}\n"
        f"distortions = {coefficients(c)}\ntranslation = {c.translation_m.tolist()}\n"
        f"rotation = {vector_from_rotation(c.rotation).tolist()}\n"
        f"fisheye = {str(c.lens is LensModel.FISHEYE).lower()}\n"
        for i, c in enumerate(rig.cameras)
    ]
    return _text(folder / "camera_array.toml", "\n".join(tables))


def vicon(rig: CameraRig, folder: Path) -> Path:
    cameras = []
    for c in rig.cameras:
        quaternion = " ".join(map(repr, Rotation.from_matrix(c.rotation).as_quat().tolist()))
        center = " ".join(map(repr, (1000.0 * c.center_m).tolist()))
        k, (width, height) = c.matrix.tolist(), c.size_px
        k1, k2, _, _, k3 = coefficients(c)
        cameras.append(
            f'<Camera DEVICEID="{c.name}" SYSTEM="DV" SENSOR_SIZE="{width + 40} {height + 20}" '
            f'VIDEO_SIZE="{width} {height}" PIXEL_ASPECT_RATIO="{k[0][0] / k[1][1]!r}"><KeyFrames><KeyFrame '
            f'FOCAL_LENGTH="{k[0][0]!r}" PRINCIPAL_POINT="{k[0][2] + 20!r} {k[1][2] + 10!r}" '
            f'ORIENTATION="{quaternion}" POSITION="{center}" '
            f'VICON_RADIAL2="none 0 0 {k1!r} {k2!r} {k3!r}" WORLD_ERROR="0.1"/></KeyFrames></Camera>'
        )
    marker = '<Camera DEVICEID="marker" SYSTEM="VX"/>'
    return _text(folder / "session.xcp", f'<?xml version="1.0"?><Cameras>{marker}{"".join(cameras)}</Cameras>')


def easymocap(rig: CameraRig, folder: Path) -> Path:
    names = "names:\n" + "".join(f'   - "{c.name}"\n' for c in rig.cameras)
    lenses = "".join(
        _yaml_matrix(f"K_{c.name}", c.matrix) + _yaml_matrix(f"dist_{c.name}", [coefficients(c)])
        + f"W_{c.name}: {c.size_px[0]}\nH_{c.name}: {c.size_px[1]}\n"
        for c in rig.cameras
    )  # fmt: skip
    places = "".join(
        _yaml_matrix(f"R_{c.name}", [vector_from_rotation(c.rotation)]) + _yaml_matrix(f"Rot_{c.name}", c.rotation)
        + _yaml_matrix(f"T_{c.name}", c.translation_m[:, None])
        for c in rig.cameras
    )  # fmt: skip
    _text(folder / "intri.yml", "%YAML:1.0\n---\n" + names + lenses)
    return _text(folder / "extri.yml", "%YAML:1.0\n---\n" + names + places)


def opencv_yaml(rig: CameraRig, folder: Path) -> Path:
    for c in rig.cameras:
        _text(
            folder / f"{c.name}.yml",
            "%YAML:1.0\n---\n"
            + f"image_width: {c.size_px[0]}\nimage_height: {c.size_px[1]}\n"
            + _yaml_matrix("camera_matrix", c.matrix)
            + _yaml_matrix("distortion_coefficients", [coefficients(c)])
            + _yaml_matrix("rvec", vector_from_rotation(c.rotation)[:, None])
            + _yaml_matrix("tvec", c.translation_m[:, None])
            + f"fisheye_model: {int(c.lens is LensModel.FISHEYE)}\n",
        )
    return folder


def opencv_xml(rig: CameraRig, folder: Path) -> Path:
    """Lenses and places in folders of their own, as Wildtrack has them."""
    for c in rig.cameras:
        size = f"<image_size>{c.size_px[0]} {c.size_px[1]}</image_size>"
        lens = _xml_matrix("camera_matrix", c.matrix) + _xml_matrix("distortion_coefficients", [coefficients(c)])
        turn, shift = (
            " ".join(map(repr, v.tolist())) for v in (vector_from_rotation(c.rotation), 1000.0 * c.translation_m)
        )
        _text(folder / "intrinsic" / f"intr_{c.name}.xml", f"<opencv_storage>{size}{lens}</opencv_storage>")
        _text(
            folder / "extrinsic" / f"extr_{c.name}.xml",
            f"<opencv_storage><rvec>\n {turn}\n</rvec><tvec>{shift}</tvec></opencv_storage>",
        )
    return folder


def jarvis(rig: CameraRig, folder: Path) -> Path:
    for c in rig.cameras:
        _text(
            folder / f"{c.name}.yaml",
            "%YAML:1.0\n---\n"
            + _yaml_matrix("T", 1000.0 * c.translation_m[:, None])
            + _yaml_matrix("R", c.rotation.T)
            + _yaml_matrix("intrinsicMatrix", c.matrix.T)
            + _yaml_matrix("distortionCoefficients", [coefficients(c)])
            + f"width: {c.size_px[0]}\nheight: {c.size_px[1]}\n",
        )
    return folder


def opencap(rig: CameraRig, folder: Path) -> Path:
    for c in rig.cameras:
        data = {
            "intrinsicMat": c.matrix.copy(),
            "distortion": np.array([coefficients(c)]),
            "imageSize": np.array([[c.size_px[1]], [c.size_px[0]]], dtype=np.float64),
            "rotation": c.rotation.copy(),
            "translation": 1000.0 * c.translation_m[:, None],
            "rotation_EulerAngles": vector_from_rotation(c.rotation)[:, None],
        }
        (folder / c.name).mkdir(parents=True)
        (folder / c.name / "cameraIntrinsicsExtrinsics.pickle").write_bytes(pickle.dumps(data))
    return folder


def mc_dev(rig: CameraRig, folder: Path) -> Path:
    for c in rig.cameras:
        pose = c.camera_from_world.copy()
        pose[:3, 3] *= 1000.0
        lines = [c.size_px, *c.matrix.tolist(), [], *pose.tolist(), [], coefficients(c)]
        _text(folder / f"{c.name}.mp4.calib", "\n".join(" ".join(map(repr, line)) for line in lines) + "\n")
    return folder


def association4d(rig: CameraRig, folder: Path) -> Path:
    data = {
        c.name: {
            "K": c.matrix.ravel().tolist(),
            "RT": c.camera_from_world[:3].ravel().tolist(),
            "imgSize": list(c.size_px),
            "distCoeff": coefficients(c),
        }
        for c in rig.cameras
    }
    return _text(folder / "calibration.json", json.dumps(data))


def panoptic(rig: CameraRig, folder: Path) -> Path:
    cameras = [
        {
            "name": c.name,
            "type": "hd",
            "resolution": list(c.size_px),
            "K": c.matrix.tolist(),
            "distCoef": coefficients(c),
            "R": c.rotation.tolist(),
            "t": (100.0 * c.translation_m[:, None]).tolist(),
        }
        for c in rig.cameras
    ]
    return _text(folder / "calibration_scene.json", json.dumps({"calibDataSource": "x", "cameras": cameras}))


def acinoset(rig: CameraRig, folder: Path) -> Path:
    cameras = [
        {
            "k": c.matrix.tolist(),
            "d": [[k] for k in c.distortion],
            "r": c.rotation.tolist(),
            "t": c.translation_m[:, None].tolist(),
        }
        for c in rig.cameras
    ]
    return _text(
        folder / "4_cam_scene_sba.json",
        json.dumps({"camera_resolution": list(rig.cameras[0].size_px), "cameras": cameras}),
    )


def scene(rig: CameraRig, folder: Path) -> Path:
    return _text(folder / "scene.json", json.dumps({"cameras": [_scene_camera(c) for c in rig.cameras]}))


def scene_of_poses(rig: CameraRig, folder: Path) -> Path:
    cameras = [_scene_camera(c) | {"R": c.rotation.T.tolist(), "T": c.center_m[:, None].tolist()} for c in rig.cameras]
    return _text(folder / "scene.json", json.dumps({"extrinsic_format": "rpt_camera_pose", "cameras": cameras}))


def old_scene(rig: CameraRig, folder: Path) -> Path:
    path = scene_of_poses(rig, folder)
    data = json.loads(path.read_text())
    del data["extrinsic_format"]
    return _text(path, json.dumps(data | {"imgpaths": ["a.png"]}))


def _scene_camera(c: Camera) -> dict:
    return {
        "name": c.name,
        "type": "fisheye" if c.lens is LensModel.FISHEYE else "pinhole",
        "width": c.size_px[0],
        "height": c.size_px[1],
        "K": c.matrix.tolist(),
        "DC": coefficients(c),
        "R": c.rotation.tolist(),
        "T": c.translation_m[:, None].tolist(),
    }


def kalibr(rig: CameraRig, folder: Path) -> Path:
    """A chain: so the first camera must stand at the world's origin."""
    text = ""
    for i, c in enumerate(rig.cameras):
        k = c.matrix
        lens = "equidistant" if c.lens is LensModel.FISHEYE else "radtan"
        text += (
            f"cam{i}:\n  camera_model: pinhole\n  distortion_model: {lens}\n"
            f"  distortion_coeffs: {coefficients(c)[:4]}\n"
            f"  intrinsics: {[float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])]}\n"
            f"  resolution: {list(c.size_px)}\n  rostopic: /cam{i}/image_raw\n"
        )
        if i:
            step = c.camera_from_world @ np.linalg.inv(rig.cameras[i - 1].camera_from_world)
            text += "  T_cn_cnm1:\n" + "".join(f"  - {row}\n" for row in step.tolist())
    return _text(folder / "camchain.yaml", text)


def label3d(rig: CameraRig, folder: Path) -> Path:
    params = np.empty((len(rig), 1), dtype=object)
    names = np.empty((1, len(rig)), dtype=object)
    for i, c in enumerate(rig.cameras):
        k1, k2, p1, p2, k3 = coefficients(c)
        params[i, 0] = {
            "K": c.matrix.T,
            "RDistort": np.array([[k1, k2, k3]]),
            "TDistort": np.array([[p1, p2]]),
            "r": c.rotation.T,
            "t": 1000.0 * c.translation_m[None],
        }
        names[0, i] = c.name
    folder.mkdir(parents=True, exist_ok=True)
    savemat(folder / "session_dannce.mat", {"params": params, "camnames": names})
    return folder / "session_dannce.mat"


def parameter_table(rig: CameraRig, folder: Path) -> Path:
    table = pa.table(
        {
            "name": list(rig.names),
            "K": [c.matrix.tolist() for c in rig.cameras],
            "dist": [coefficients(c) for c in rig.cameras],
            "rvec": [vector_from_rotation(c.rotation).tolist() for c in rig.cameras],
            "T": [c.translation_m.tolist() for c in rig.cameras],
            "width": [c.size_px[0] for c in rig.cameras],
            "height": [c.size_px[1] for c in rig.cameras],
        }
    )
    folder.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, folder / "camera_params.parquet")
    return folder / "camera_params.parquet"


def nested_table(rig: CameraRig, folder: Path) -> Path:
    """Write the intrinsic and extrinsic parameters as structs, like a notebook with awkward arrays."""
    intrinsic = [{"camera_matrix": c.matrix.tolist(), "distortion_coefficients": coefficients(c)} for c in rig.cameras]
    extrinsic = [
        {"rvec": vector_from_rotation(c.rotation)[:, None].tolist(), "tvec": c.translation_m[:, None].tolist()}
        for c in rig.cameras
    ]
    sizes = [{"width": c.size_px[0], "height": c.size_px[1]} for c in rig.cameras]
    columns = {"name": list(rig.names), "intrinsic": intrinsic, "extrinsic": extrinsic, "resolution": sizes}
    folder.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(columns), folder / "camera_params.parquet")
    return folder / "camera_params.parquet"


def projections(rig: CameraRig, folder: Path) -> Path:
    """With a factor and a sign of no meaning."""
    factors = np.resize([2.0, -0.5, 1.0], len(rig))
    matrices = np.stack([f * c.matrix @ c.camera_from_world[:3] for f, c in zip(factors, rig.cameras, strict=True)])
    folder.mkdir(parents=True, exist_ok=True)
    np.save(folder / "projections.npy", matrices)
    return folder / "projections.npy"


def projection_texts(rig: CameraRig, folder: Path) -> Path:
    for c in rig.cameras:
        rows = (c.matrix @ c.camera_from_world[:3]).tolist()
        _text(folder / f"P_{c.name}.txt", "\n".join(" ".join(map(repr, row)) for row in rows))
    return folder


def anipose(rig: CameraRig, folder: Path) -> Path:
    return _text(folder / "calibration.toml", anipose_toml(rig))


def pose2sim(rig: CameraRig, folder: Path) -> Path:
    return _text(folder / "Calib.toml", pose2sim_toml(rig))


def qualisys(rig: CameraRig, folder: Path) -> Path:
    return _text(folder / "Calib.qca.txt", qualisys_xml(rig))


WRITERS: dict[str, Callable[[CameraRig, Path], Path]] = {
    writer.__name__: writer
    for writer in (
        caliscope_old, caliscope_new, vicon, easymocap, opencv_yaml, opencv_xml, jarvis, opencap, mc_dev, association4d,
        panoptic, acinoset, scene, scene_of_poses, old_scene, kalibr, label3d, parameter_table, nested_table,
        projections,
        projection_texts, anipose, pose2sim, qualisys,
    )
}  # fmt: skip


def _text(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def _yaml_matrix(name: str, values: object) -> str:
    array = np.asarray(values, dtype=np.float64)
    rows, columns = array.shape
    numbers = ", ".join(map(repr, array.ravel().tolist()))
    return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {numbers} ]\n"


def _xml_matrix(name: str, values: object) -> str:
    array = np.asarray(values, dtype=np.float64)
    rows, columns = array.shape
    numbers = " ".join(map(repr, array.ravel().tolist()))
    shape = f"<rows>{rows}</rows><cols>{columns}</cols><dt>d</dt>"
    return f'<{name} type_id="opencv-matrix">{shape}<data>{numbers}</data></{name}>'


CAMERA_NAMES = {
    "acinoset": "cam{}", "kalibr": "cam{}", "projections": "{}", "caliscope_old": "cam_{}", "caliscope_new": "cam_{}",
}  # fmt: skip
"""Patterns of camera names in formats that do not keep names."""


def rig_for(name: str, lens: str = "mild") -> CameraRig:
    """Return three cameras that a format can represent."""
    cameras = []
    first = 1 if name == "acinoset" else 0
    world = ring(3).cameras[0].camera_from_world if name == "kalibr" else np.eye(4)
    for i, camera in enumerate(ring(3, lens).cameras):
        distortion = camera.distortion
        if camera.lens is LensModel.BROWN and name in ("kalibr", "pose2sim"):
            distortion = (*distortion[:4], 0.0)
        if name == "vicon":
            distortion = (*distortion[:2], 0.0, 0.0, 0.003)
        pose = camera.camera_from_world @ np.linalg.inv(world)
        camera_name = CAMERA_NAMES.get(name, "left_{}").format(i + first)
        size = (round(2 * camera.matrix[0, 2]), round(2 * camera.matrix[1, 2]))
        camera = replace(camera, name=camera_name, distortion=distortion, camera_from_world=pose, size_px=size)
        if name.startswith("projection"):
            camera = replace(camera, lens=LensModel.PINHOLE, distortion=())
        cameras.append(camera)
    return CameraRig(tuple(cameras))
