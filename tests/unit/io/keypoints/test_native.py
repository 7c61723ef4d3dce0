"""Keypoint files in posefuse's own format."""

import numpy as np
import pytest

from posefuse import read_detections
from posefuse.errors import FileError
from posefuse.io.keypoints import native
from posefuse.io.netcdf import StoredArray
from posefuse.model.detections import Detections
from posefuse.synthetic.options import CLEAN, SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.example_detections import ragged_detections


@pytest.fixture(scope="module")
def walk() -> Detections:
    return simulate(SceneOptions(skeleton="body_25", duration_s=0.5, cameras=3, detector=CLEAN)).detections


class TestNative:
    def test_round_trip_reads_on_demand(self, tmp_path, rng):
        crowd = ragged_detections(rng)
        native.write(crowd, tmp_path / "keypoints.nc")
        detections = read_detections(tmp_path / "keypoints.nc")
        assert isinstance(detections.keypoints_px, StoredArray)
        assert detections == crowd
        np.testing.assert_array_equal(detections.frames(2, 4).keypoints_px, crowd.frames(2, 4).keypoints_px)

    def test_same_input_gives_the_same_bytes(self, tmp_path, rng):
        crowd = ragged_detections(rng)
        for name in ("a.nc", "b.nc"):
            native.write(crowd, tmp_path / name)
        assert (tmp_path / "a.nc").read_bytes() == (tmp_path / "b.nc").read_bytes()

    def test_keypoints_are_mapped_on_request(self, walk, tmp_path):
        native.write(walk, tmp_path / "keypoints.nc")
        assert read_detections(tmp_path / "keypoints.nc", "coco_17").skeleton.name == "coco_17"

    @pytest.mark.parametrize("keep", [0, 10, 0.3, 0.95])
    def test_truncated_files_are_refused(self, keep, tmp_path, rng):
        path = tmp_path / "keypoints.nc"
        native.write(ragged_detections(rng), path)
        content = path.read_bytes()
        path.write_bytes(content[: int(keep * len(content)) if keep < 1 else int(keep)])
        with pytest.raises(FileError, match=r"keypoints\.nc"):
            read_detections(path)
