"""Written files are read back: losslessly, or up to the documented precision of the format."""

import re
import tempfile
from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import posefuse
from posefuse.errors import FileError
from posefuse.io.calibration.read import find_format
from posefuse.io.calibration.registry import CALIBRATIONS as REGISTRY
from posefuse.io.calibration.write import write_as
from posefuse.io.keypoints import native
from posefuse.io.results import c3d_reading, trc
from posefuse.io.results.axes import y_up_from_world
from posefuse.model.cameras import UP_AXES, Camera, CameraRig, LensModel
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer, Provenance, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus, is_used
from posefuse.model.tracks import Tracks
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.example_detections import ragged_detections
from tests.figures import model_layer
from tests.properties import examples
from tests.scenes import ring, skeleton_of

seeds = st.integers(0, 2**32 - 1)
words = st.text(
    st.characters(codec="utf-8", exclude_characters="\x00", exclude_categories=["Cs"]), min_size=1, max_size=8
)
_SIZES = {LensModel.PINHOLE: 0, LensModel.BROWN: 5, LensModel.RATIONAL: 8, LensModel.FISHEYE: 4}


def any_rig(rng: np.random.Generator, names: list[str], lenses: list[LensModel]) -> CameraRig:
    cameras = []
    for name, lens in zip(names, lenses, strict=True):
        pose = np.eye(4)
        pose[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        pose[:3, :3] *= np.linalg.det(pose[:3, :3])
        pose[:3, 3] = rng.normal(size=3)
        matrix = np.array([[rng.uniform(100, 3000), rng.normal(), 640], [0, rng.uniform(100, 3000), 480], [0, 0, 1]])
        coefficients = tuple(rng.normal(scale=0.1, size=_SIZES[lens]))
        cameras.append(Camera(name, (1280, 960), matrix, pose, lens, coefficients))
    return CameraRig(tuple(cameras))


def any_result(rng: np.random.Generator, rig: CameraRig, people: list[str], frames: int) -> Reconstruction:
    """Return random numbers in every field, a third of them missing."""
    shape = frames, len(people), 4
    views = len(rig)

    def numbers(*more: int) -> np.ndarray:
        values = rng.normal(size=(*shape, *more)) * 10.0 ** rng.integers(-12, 12, (*shape, *more))
        return np.where(rng.random((*shape, *more)) < 0.3, np.nan, values)

    layer = Layer(
        points_m=numbers(3),
        covariance_m2=numbers(6),
        status=rng.choice([int(code) for code in PointStatus], shape).astype(np.int8),
        source=rng.choice([int(code) for code in Source], shape).astype(np.int8),
        reprojection_error_px=numbers(),
        view_status=rng.choice([int(code) for code in ViewStatus], (*shape, views)).astype(np.int8),
        view_error_px=numbers(views).astype(np.float32),
    )
    return Reconstruction(
        rig=rig,
        skeleton=skeleton_of(4),
        person_ids=tuple(people),
        frame_numbers=np.cumsum(rng.integers(1, 5, frames)),
        time_s=np.sort(rng.uniform(0, 10, frames)),
        layers={"measured": layer},
        tracks=Tracks(
            tuple(people),
            rng.integers(-1, 4, (frames, len(people), views)).astype(np.int32),
            rng.integers(0, 4, (frames, len(people))).astype(np.int8),
        ),
        noise=NoiseModel(rng.uniform(0.1, 9, views), 0.5, "estimated"),
        rate_hz=float(rng.uniform(1, 500)),
        options=Options(start_s=0.25, triangulation=TriangulationOptions(min_views=2)),
        provenance=Provenance({"posefuse": "1"}, {"a": "b"}, ("ä note", "another")),
    )


@given(
    seed=seeds,
    cameras=st.lists(st.tuples(words, st.sampled_from(LensModel)), min_size=1, max_size=4, unique_by=lambda c: c[0]),
    people=st.lists(words, min_size=1, max_size=3, unique=True),
    frames=st.integers(1, 12),
    up=st.sampled_from([None, *UP_AXES]),
    size=st.integers(1, 12),
)
@examples(25)
def test_reconstructions_are_lossless(seed, cameras, people, frames, up, size):
    rng = np.random.default_rng(seed)
    rig = replace(any_rig(rng, [c[0] for c in cameras], [c[1] for c in cameras]), up_axis=up, notes=("ü",))
    result = any_result(rng, rig, people, frames)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "reconstruction.nc"
        from posefuse.io.results import netcdf
        from posefuse.io.results.rounding import rounded

        netcdf.write(result.chunks(size), path)
        assert posefuse.read_reconstruction(path) == rounded(result)


@given(seed=seeds, frames=st.integers(1, 8), views=st.integers(1, 4))
@examples(25)
def test_detections_are_lossless(seed, frames, views):
    detections = ragged_detections(np.random.default_rng(seed), frames, views)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "keypoints.nc"
        native.write(detections, path)
        assert posefuse.read_detections(path) == detections


CALIBRATIONS = {"anipose": "calibration.toml", "pose2sim": "calibration.toml", "qualisys": "calibration.qca.txt"}
OTHER_LENSES = {
    "anipose": (),
    "pose2sim": (LensModel.RATIONAL, LensModel.FISHEYE, LensModel.BROWN),
    "qualisys": (LensModel.RATIONAL, LensModel.FISHEYE),
}
"""Lenses that the formats cannot represent; for Pose2Sim, those with k3."""


@pytest.mark.parametrize("form", CALIBRATIONS)
@given(
    seed=seeds,
    names=st.lists(words, min_size=1, max_size=12, unique=True),
    lens=st.sampled_from(LensModel),
    up=st.sampled_from([None, "y", "z", "z", "z"]),
    said=st.lists(words, max_size=2),
)
@examples(25)
def test_calibrations_keep_every_camera(form, seed, names, lens, up, said):
    """Formats report what they cannot represent, and then write nothing."""
    rig = any_rig(np.random.default_rng(seed), names, [lens] * len(names))
    if form == "qualisys":
        # XML has one character for the end of a line.
        said = [re.sub("\r\n?", "\n", text) for text in said]
    rig = replace(rig, up_axis=up, notes=tuple(said), left_out=tuple(said))
    if form == "pose2sim" and lens is LensModel.BROWN and seed % 2:
        rig = replace(rig, cameras=tuple(replace(c, distortion=(*c.distortion[:4], 0.0)) for c in rig.cameras))
        lens = LensModel.PINHOLE
    refused = lens in OTHER_LENSES[form] or (form != "anipose" and up != "z")
    impossible = form == "qualisys" and any(
        re.search(r"[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]", x) for x in [*names, *said]
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / CALIBRATIONS[form]
        written = REGISTRY.find(form)
        if refused or impossible:
            with pytest.raises(FileError, match=f"(?i){form}"):
                write_as(written, rig, path)
            assert list(Path(folder).iterdir()) == []
            return
        write_as(written, rig, path)
        assert find_format(path).name == form
        read_rig = posefuse.read_cameras(path)
    assert (read_rig.names, read_rig.notes, read_rig.left_out, read_rig.up_axis) == (
        rig.names,
        rig.notes,
        rig.left_out,
        up,
    )
    for a, b in zip(read_rig.cameras, rig.cameras, strict=True):
        np.testing.assert_array_equal(a.matrix, b.matrix)
        assert (a.lens, a.size_px) == (b.lens if b.lens is not LensModel.PINHOLE else a.lens, b.size_px)
        assert a.distortion == b.distortion or not any((*a.distortion, *b.distortion))
        np.testing.assert_allclose(a.camera_from_world, b.camera_from_world, atol=1e-12)


@given(seed=seeds, frames=st.integers(1, 12), up=st.sampled_from([None, *UP_AXES]))
@examples(25)
def test_trc_keeps_micrometers(seed, frames, up):
    rng = np.random.default_rng(seed)
    rig = replace(any_rig(rng, ["a", "b"], [LensModel.PINHOLE] * 2), up_axis=up)
    result = any_result(rng, rig, ["someone"], frames)
    layer = result.layers["measured"]
    points = rng.uniform(-9, 9, layer.points_m.shape)
    points[rng.random(points.shape[:-1]) < 0.3] = np.nan
    result = replace(result, layers={"measured": replace(layer, points_m=points)})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "someone.trc"
        posefuse.write(result, path)
        actual, stored = trc.read(path), posefuse.read_points(path)
    assert (stored.person_ids, stored.keypoints, stored.unit) == (("someone",), result.skeleton.keypoints, "m")
    np.testing.assert_array_equal(stored.points_m[:, 0], actual.points_m)
    np.testing.assert_array_equal(stored.time_s, actual.time_s)
    places = result.frame_numbers - result.frame_numbers[0]
    np.testing.assert_allclose(actual.points_m[places] @ y_up_from_world(up), points[:, 0], atol=6e-7)
    between = np.setdiff1d(np.arange(len(actual.points_m)), places)
    assert np.isnan(actual.points_m[between]).all()
    assert actual.rate_hz == pytest.approx(result.rate_hz, rel=1e-9)


def residuals_everywhere(content: ezc3d.c3d) -> np.ndarray:
    """Return values as ezc3d reads them, shape (frame, point)."""
    return content["data"]["meta_points"]["residuals"][0].T


@given(seed=seeds, frames=st.integers(1, 12), views=st.integers(1, 9))
@examples(15)
def test_c3d_keeps_its_documented_contents(seed, frames, views):
    """Another program reads single precision, up to seven views, and which points were filled."""
    rng = np.random.default_rng(seed)
    rig = any_rig(rng, [f"camera {v}" for v in range(views)], [LensModel.PINHOLE] * views)
    result = any_result(rng, rig, ["someone"], frames)
    layer = result.layers["measured"]
    points = rng.uniform(-9, 9, layer.points_m.shape)
    points[rng.random(points.shape[:-1]) < 0.3] = np.nan
    status = np.where(np.isnan(points[..., 0]), PointStatus.NOT_SEEN, PointStatus.OK).astype(np.int8)
    layer = replace(layer, points_m=points, status=status, covariance_m2=np.abs(layer.covariance_m2))
    result = replace(result, layers={"measured": layer})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "someone.c3d"
        posefuse.write(result, path)
        content = ezc3d.c3d(str(path))
        stored, other = posefuse.read_points(path), c3d_reading.read(path)
    places = result.frame_numbers - result.frame_numbers[0]
    actual = content["data"]["points"][:3].transpose(2, 1, 0)[places]
    np.testing.assert_allclose(actual, 1000.0 * points[:, 0], rtol=1e-6)
    given_sd = 1000.0 * np.sqrt((layer.sd_m[:, 0] ** 2).mean(axis=-1))
    missing, filled = np.isnan(points[:, 0, :, 0]), np.asarray(layer.source)[:, 0] == Source.FILLED
    np.testing.assert_array_equal(residuals_everywhere(content) == -1.0, other.residual == -1.0)
    np.testing.assert_array_equal(other.residual[places] == -1.0, missing)
    results = ~(missing | filled | np.isnan(given_sd))
    np.testing.assert_allclose(other.residual[places][results], np.clip(given_sd[results], 0.1, 25.5), atol=0.0501)
    assert (other.residual[places][~results & ~missing] == 0.0).all()
    used = is_used(np.asarray(layer.view_status)[:, 0]) & ~(missing | filled)[..., None]
    bits = np.zeros((frames, 4, 7), dtype=bool)
    bits[..., :views] = used if views <= 7 else False
    np.testing.assert_array_equal(other.cameras[places], bits)
    assert content["parameters"]["POINT"]["RATE"]["value"][0] == pytest.approx(result.rate_hz, rel=1e-6)
    assert content["parameters"]["POINT"]["LABELS"]["value"] == list(result.skeleton.keypoints)
    np.testing.assert_allclose(stored.points_m[places][:, 0], points[:, 0], rtol=1e-6)
    np.testing.assert_array_equal(np.isnan(stored.points_m[..., 0][:, 0]), residuals_everywhere(content) == -1.0)
    assert (stored.keypoints, stored.person_ids, stored.unit) == (result.skeleton.keypoints, ("someone",), "m")
    assert (stored.layer, stored.rate_hz) == ("measured", pytest.approx(result.rate_hz, rel=1e-6))
    np.testing.assert_array_equal(stored.frame_numbers[places], result.frame_numbers)
    np.testing.assert_allclose(stored.time_s, stored.frame_numbers / stored.rate_hz)
    if views <= 7:
        np.testing.assert_array_equal(stored.n_views[places][:, 0], used.sum(axis=-1))
    else:
        assert stored.n_views is None


@given(
    seed=seeds,
    frames=st.integers(1, 5),
    people=st.integers(1, 3),
    skeleton=st.sampled_from(["openpose_137", "coco_17"]),
)
@examples(8)
def test_overlays_are_read_as_detections(seed, frames, people, skeleton):
    """Each point has its projected pixel, to a thousandth of a pixel; people outside the image are absent."""
    rng = np.random.default_rng(seed)
    body, rig = shipped_skeleton(skeleton), ring(3)
    points = rng.normal((0.0, 0.0, 1.0), 0.8, (frames, people, len(body), 3))
    points[rng.random(points.shape[:-1]) < 0.3] = np.nan
    result = replace(
        any_result(rng, rig, [f"p{i}" for i in range(people)], frames),
        skeleton=body, tracks=None, layers={"measured": model_layer(points)},
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        posefuse.write(result, Path(folder) / "overlay", "openpose")
        detections = posefuse.read_detections(Path(folder) / "overlay", skeleton)
    np.testing.assert_array_equal(np.intersect1d(detections.frame_numbers, result.frame_numbers), result.frame_numbers)
    for f, number in enumerate(result.frame_numbers.tolist()):
        for v, camera in enumerate(rig.cameras):
            row = int(np.flatnonzero(detections.frame_numbers == number)[0]) * len(rig) + v
            start, stop = detections.offsets[row : row + 2]
            pixels, _ = camera.project(points[f])
            inside = ((pixels >= -0.5) & (pixels <= np.array(camera.size_px) - 0.5)).all(axis=-1)
            visible = np.where(inside[..., None], pixels, np.nan)[inside.any(axis=-1)]
            np.testing.assert_allclose(np.asarray(detections.keypoints_px)[start:stop], visible, atol=6e-4)
            np.testing.assert_array_equal(
                np.asarray(detections.track_ids)[start:stop], np.flatnonzero(inside.any(axis=-1))
            )
