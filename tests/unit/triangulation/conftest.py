"""Walks in front of cameras with outliers, shared by the tests of all triangulation methods."""

import numpy as np
import pytest
from benchmarks.walking import Walk, walk

from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.pipeline.reconstruct import triangulate


def triangulate_walk(data: Walk, method: str, **options: object) -> Layer:
    """Return the measured layer of a method, with labels as they are."""
    chosen = TriangulationOptions(method=method, **options)  # type: ignore[arg-type]
    return triangulate(data.rig, data.detections, Options(pairs="labels", triangulation=chosen)).layers["measured"]


def errors_mm(data: Walk, layer: Layer) -> np.ndarray:
    """Return distances from the true points, shape (frame, keypoint)."""
    return 1000 * np.linalg.norm(layer.points_m[:, 0] - data.points_m, axis=-1)


@pytest.fixture(scope="session")
def clean() -> Walk:
    """Return a walk without outliers."""
    return walk(60)


@pytest.fixture(scope="session")
def ugly() -> Walk:
    """Return a walk with 5 % outliers."""
    return walk(120, outlier_share=0.05)
