"""Covariance of the parameters of a camera."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import CameraError
from posefuse.model.camera_covariance import CENTER, CameraCovariance
from tests.scenes import ring

MATRIX = np.array([[4.0, 1.0], [1.0, 9.0]])


def test_parameters_are_found_by_name():
    covariance = CameraCovariance("a", ("center_x_m", "fx_px"), MATRIX)
    assert covariance.sd("fx_px") == 3.0
    assert covariance.block(("fx_px", "center_x_m")).tolist() == [[9.0, 1.0], [1.0, 4.0]]
    assert covariance.block(CENTER).tolist() == np.diag([4.0, 0.0, 0.0]).tolist()
    with pytest.raises(CameraError, match="no parameter 'fx'"):
        covariance.sd("fx")


def test_a_correlation_of_another_size_is_refused():
    rig, covariance = ring(2), CameraCovariance("cam_0", ("fx_px", "fy_px"), MATRIX)
    assert replace(rig, covariances=(covariance,)).covariance() is None
    with pytest.raises(CameraError, match="2 x 2"):
        replace(rig, covariances=(covariance,), correlation=np.eye(3))


@pytest.mark.parametrize(
    ("parameters", "matrix", "message"),
    [
        (("fx_px",), MATRIX, "must have shape"),
        (("fx_px", "fx_px"), MATRIX, "different parameters"),
        (("fx_px", "fy_px"), [[1.0, np.nan], [np.nan, 1.0]], "not finite"),
        (("fx_px", "fy_px"), [[1.0, 0.5], [0.4, 1.0]], "symmetric"),
        (("fx_px", "fy_px"), [[-1.0, 0.0], [0.0, 1.0]], "positive diagonal"),
    ],
)
def test_what_is_no_covariance_is_refused(parameters, matrix, message):
    with pytest.raises(CameraError, match=message):
        CameraCovariance("a", parameters, np.array(matrix))
