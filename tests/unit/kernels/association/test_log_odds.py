"""Log odds of many keypoints."""

import math

import numpy as np
import pytest

from posefuse.kernels.association.log_odds import log_of_product
from posefuse.kernels.jit import kernel


@kernel
def total(factors):
    return log_of_product(factors)


@pytest.mark.parametrize("n", [0, 1, 12, 16, 17, 133, 553])
@pytest.mark.parametrize("scale", [1e-8, 1.0, 1e8])
def test_products_neither_overflow_nor_vanish(n, scale):
    factors = scale * np.random.default_rng(n).uniform(0.5, 2.0, n)
    assert total(factors) == pytest.approx(math.fsum(np.log(factors)), rel=1e-12, abs=1e-12)
