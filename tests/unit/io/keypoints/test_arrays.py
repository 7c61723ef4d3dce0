"""Arrays of keypoints in NumPy files."""

import numpy as np
import pytest

from posefuse import Options, read_cameras, read_detections
from posefuse.errors import DetectionsError, FileError, PosefuseError
from posefuse.io.files import read_npz
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.layouts import (
    SCENE,
)


@pytest.fixture(scope="module")
def walk() -> Detections:
    return simulate(SceneOptions(skeleton="body_25", duration_s=0.5, cameras=3, detector=CLEAN)).detections


class TestArrays:
    @pytest.fixture
    def pixels(self, walk) -> np.ndarray:
        return np.moveaxis(walk.to_skeleton(find_skeleton("halpe_26")).dense()[0], 0, 1)

    def test_two_channels(self, pixels, tmp_path):
        np.save(tmp_path / "points.npy", pixels)
        detections = read_detections(tmp_path / "points.npy")
        assert detections.skeleton.name == "halpe_26"
        np.testing.assert_array_equal(detections.dense()[0], np.moveaxis(pixels, 0, 1))
        assert detections.view_names == ("0", "1", "2")

    @pytest.mark.parametrize("meaning", ["confidence", "depth"])
    def test_third_channel_needs_a_meaning(self, meaning, pixels, tmp_path):
        third = np.linspace(0.1, 0.9, pixels[..., 0].size).reshape(pixels.shape[:-1])
        path = tmp_path / "points.npy"
        np.save(path, np.concatenate([pixels, third[..., None]], axis=-1))
        with pytest.raises(DetectionsError, match="`third_channel='confidence'` or `third_channel='depth'`"):
            read_detections(path)
        detections = read_detections(path, options=Options(third_channel=meaning, rate_hz=25.0))
        assert detections.rate_hz == 25.0
        values = detections.confidence if meaning == "confidence" else detections.depth
        np.testing.assert_array_equal(np.asarray(values).reshape(detections.n_frames, 3, 26), np.moveaxis(third, 0, 1))
        assert (detections.depth is None) == (meaning == "confidence")

    @pytest.mark.parametrize("shape", [(3, 20), (3, 20, 1)])
    @pytest.mark.parametrize("suffix", [".npy", ".npz"])
    def test_one_point_per_frame_needs_no_skeleton(self, shape, suffix, rng, tmp_path):
        pixels, path = rng.uniform(0, 1000, (*shape, 2)), tmp_path / f"wand{suffix}"
        extra = {} if suffix == ".npy" else {"confidence": np.full(shape, 0.5)}
        np.save(path, pixels) if suffix == ".npy" else np.savez(path, keypoints=pixels, **extra)
        detections = read_detections(path)
        assert detections.skeleton.keypoints == ("point",)
        np.testing.assert_array_equal(detections.dense()[0][:, :, 0], np.moveaxis(pixels.reshape(3, 20, 2), 0, 1))
        assert suffix == ".npy" or (np.asarray(detections.confidence) == 0.5).all()

    def test_npz_with_names_rate_and_confidence(self, pixels, tmp_path):
        path = tmp_path / "points.npz"
        np.savez(path, keypoints=pixels, names=["a", "b", "c"], rate_hz=25.0, confidence=np.full(pixels.shape[:3], 0.5))
        detections = read_detections(path)
        assert detections.view_names == ("a", "b", "c")
        assert detections.rate_hz == 25.0
        assert (np.asarray(detections.confidence) == 0.5).all()

    @pytest.mark.parametrize(
        ("extra", "words"),
        [
            ({"confidence": np.ones((2, 3))}, r"expected confidence \[camera, frame, keypoint\]"),
            ({"rate_hz": np.array([30.0, 60.0])}, "expected one number for rate_hz"),
            ({"rate_hz": np.array("thirty")}, "expected one number for rate_hz"),
        ],
    )
    def test_inconsistent_npz_is_refused(self, extra, words, pixels, tmp_path):
        np.savez(tmp_path / "k.npz", keypoints=pixels, **extra)
        with pytest.raises(FileError, match=words):
            read_detections(tmp_path / "k.npz")

    def test_zeros_are_missing(self, pixels, tmp_path):
        spoilt = pixels.copy()
        spoilt[0, 1, 2] = spoilt[1, 0, 4] = 0.0
        np.save(tmp_path / "k.npy", spoilt)
        detections = read_detections(tmp_path / "k.npy")
        assert np.isnan(detections.dense()[0][1, 0, 2]).all()
        assert "2 keypoints at exactly (0, 0)" in detections.notes[-1]

    def test_skeleton_of_another_size_is_refused(self, pixels, tmp_path):
        np.save(tmp_path / "k.npy", pixels)
        with pytest.raises(FileError, match="26 keypoints per person, but skeleton coco_17 has 17"):
            read_detections(tmp_path / "k.npy", "coco_17")

    def test_one_coordinate_alone_is_missing(self, pixels, tmp_path):
        pixels[0, 0, 3, 1] = np.nan
        np.save(tmp_path / "points.npy", pixels)
        assert np.isnan(read_detections(tmp_path / "points.npy").dense()[0][0, 0, 3]).all()

    @pytest.mark.parametrize(
        ("array", "words"),
        [
            (np.zeros((3, 4, 26)), r"\[camera, frame, keypoint, 2 or 3\], got float64 of shape \(3, 4, 26\)"),
            (np.zeros((3, 4, 26, 4)), r"shape \(3, 4, 26, 4\)"),
            (np.full((3, 4, 26, 2), "x"), "got <U1"),
            (np.full((3, 4, 26, 2), np.inf), "infinite"),
        ],
    )
    def test_other_shapes_are_refused(self, array, words, tmp_path):
        np.save(tmp_path / "points.npy", array)
        with pytest.raises(PosefuseError, match=words):
            read_detections(tmp_path / "points.npy", "halpe_26")

    def test_pickles_are_refused(self, tmp_path):
        np.save(tmp_path / "points.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
        with pytest.raises(FileError, match="cannot be|can be read"):
            read_detections(tmp_path / "points.npy")

    def test_truncated_file_is_refused(self, pixels, tmp_path):
        path = tmp_path / "points.npy"
        np.save(path, pixels)
        path.write_bytes(path.read_bytes()[:-100])
        with pytest.raises(FileError, match="truncated"):
            read_detections(path)

    def test_npz_without_a_keypoint_array(self, pixels, tmp_path):
        np.savez(tmp_path / "points.npz", a=pixels, b=pixels)
        with pytest.raises(FileError, match="must be called 'keypoints'"):
            read_detections(tmp_path / "points.npz")


class TestArraysOfOneRig:
    def test_cameras_and_points_of_one_file(self, tmp_path):
        """Read the arrays of one rig, world to camera."""
        rig = SCENE.rig
        content = {
            "K": np.stack([c.matrix for c in rig.cameras]), "R": np.stack([c.rotation for c in rig.cameras]),
            "tvec": np.stack([c.translation_m for c in rig.cameras]), "points2d_px": np.ones((2, 4, 38, 2)),
            "names": np.array(rig.names), "size": np.array([c.size_px for c in rig.cameras]),
        }  # fmt: skip
        np.savez(tmp_path / "fly.npz", **content)
        read_rig = read_cameras(tmp_path / "fly.npz", length_unit="m")
        for a, b in zip(read_rig.cameras, rig.cameras, strict=True):
            assert (a.name, a.size_px) == (b.name, b.size_px)
            np.testing.assert_allclose(a.camera_from_world, b.camera_from_world, atol=1e-12)
        fly = read_detections(tmp_path / "fly.npz")
        assert (fly.skeleton.name, fly.view_names, fly.n_frames) == ("fly_38", ("0", "1"), 4)
        np.savez(tmp_path / "fly.npz", **(content | {"tvec": np.zeros((3, 3))}))
        with pytest.raises(FileError, match=r"t must have 2 cameras, as K does; got shape \(3, 3\)"):
            read_cameras(tmp_path / "fly.npz")

    def test_points_without_a_skeleton(self, tmp_path):
        np.save(tmp_path / "p2d.npy", np.array([[[1.0, 2], [3, 4]], [[np.nan, np.nan], [5, 6]]]))
        detections = read_detections(tmp_path / "p2d.npy")
        assert detections.skeleton.keypoints == ("point",)
        np.testing.assert_array_equal(detections.dense()[0][:, 0, 0], [[1, 2], [3, 4]])

    def test_decompression_bomb_is_refused(self, tmp_path, monkeypatch):
        """The limit is lowered, so that megabytes of zeros stand for gigabytes."""
        monkeypatch.setattr("posefuse.io.files._LARGE_BYTES", 256_000)
        file = tmp_path / "bomb.npz"
        np.savez_compressed(file, keypoints=np.zeros((2, 20_000, 17, 2)))
        with pytest.raises(FileError, match=r"would expand to 10880128 bytes"):
            read_detections(file)
        assert set(read_npz(file, ())) == {"keypoints"}

    def test_objects_are_refused(self, tmp_path):
        np.save(tmp_path / "evil.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
        with pytest.raises(FileError, match="not a complete NumPy array file: Object arrays cannot be loaded"):
            read_detections(tmp_path / "evil.npy")
