"""Vicon calibrations."""

import re

from posefuse import read_cameras
from tests import calibrations
from tests.calibrations import rig_for


def test_vicon_radial_distortion_has_two_or_three_coefficients(tmp_path):
    path = calibrations.vicon(rig_for("vicon"), tmp_path)
    text = path.read_text()
    for original, read in (("VICON_RADIAL2='w 7 8 0.1 -0.2'", (0.1, -0.2, 0.0, 0.0, 0.0)),
                        ("VICON_RADIAL2='w 7 8 0.1 -0.2 0.3'", (0.1, -0.2, 0.0, 0.0, 0.3)),
                        ("VICON_RADIAL='0.1 -0.2'", (0.1, -0.2, 0.0, 0.0, 0.0))):  # fmt: skip
        path.write_text(re.sub('VICON_RADIAL2="[^"]*"', original, text))
        assert {camera.distortion for camera in read_cameras(path).cameras} == {read}
