"""Kalibr calibrations."""

import pytest

from posefuse import read_cameras
from posefuse.errors import FileError
from tests import calibrations
from tests.calibrations import rig_for


def test_unsupported_kalibr_model_error_lists_the_supported_ones(tmp_path):
    path = calibrations.kalibr(rig_for("kalibr"), tmp_path)
    path.write_text(path.read_text().replace("pinhole", "omni", 1))
    with pytest.raises(FileError, match="cam0: camera model 'omni'"):
        read_cameras(path)
