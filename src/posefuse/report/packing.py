"""Compact encoding of arrays in the report page: small integers in base64, with the parameters to decode them."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, Source, ViewStatus, is_used

_STEPS = 32767
_MISSING_POINT = -32768
_INLIER_QUANTILE = 0.995
_EXTENT_FACTOR = 3.0
"""The grid extends to this multiple of the distance that ``_INLIER_QUANTILE`` of the points do not exceed."""
_SMALLEST_M, _LARGEST_M = 1e-6, 1e3
_LOG_STEPS = 254
MARKED_VIEWS = 32
"""With more cameras than this, the page leaves out the status of each point in each view."""


@dataclass(frozen=True)
class PackingGrid:
    """A grid on which coordinates are stored as integers.

    Attributes:
        origin: x, y, z of the integer 0, in the unit of the points.
        step: distance between consecutive integers.
    """

    origin: tuple[float, float, float]
    step: float


def fit_grid(points: np.ndarray) -> PackingGrid:
    """Return a grid that holds the bulk of the points; distant outliers do not make its step coarse."""
    flat = points.reshape(-1, 3)
    flat = flat[np.isfinite(flat).all(axis=-1)]
    if not len(flat):
        return PackingGrid((0.0, 0.0, 0.0), 1e-3)
    origin = np.median(flat, axis=0).astype(np.float64)
    distance = np.abs(flat - origin).max(axis=-1)
    extent = min(_EXTENT_FACTOR * float(np.quantile(distance, _INLIER_QUANTILE)), float(distance.max())) or 1.0
    x, y, z = (float(value) for value in origin.round(6))
    # A slightly longer step keeps the farthest point inside the grid in spite of rounding.
    return PackingGrid((x, y, z), float(f"{1.0001 * extent / _STEPS:.6g}"))


def pack_points(points: np.ndarray, grid: PackingGrid) -> tuple[str, int]:
    """Encode points of shape (..., 3) as base64 of int16, and return the number of points outside the grid."""
    with np.errstate(invalid="ignore"):
        steps = np.round((points - np.array(grid.origin)) / grid.step)
        inside: np.ndarray = np.all(np.abs(steps) <= _STEPS, axis=-1)
    finite = np.isfinite(points).all(axis=-1)
    out = np.where(inside[..., None], np.nan_to_num(steps), _MISSING_POINT).astype("<i2")
    return _base64(out), int((finite & ~inside).sum())


def pack_covariances(covariance_m2: np.ndarray) -> str:
    """Encode covariances of shape (..., 6) as 7 bytes: size on a logarithmic scale, and Cholesky factor relative to it.

    Sizes are rounded up, so an ellipsoid is never drawn more than 1 % too small.
    """
    xx, xy, xz, yy, yz, zz = np.moveaxis(np.asarray(covariance_m2, dtype=np.float64), -1, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        a = np.sqrt(xx)
        b, c = xy / a, xz / a
        d = np.sqrt(np.maximum(yy - b * b, 0.0))
        e = np.where(d > 0, (yz - b * c) / d, 0.0)
        f = np.sqrt(np.maximum(zz - c * c - e * e, 0.0))
        factor = np.stack([a, b, c, d, e, f], axis=-1)
        size = np.abs(factor).max(axis=-1)
        known = np.isfinite(factor).all(axis=-1) & (size > 0)
        place = np.log(np.clip(size, _SMALLEST_M, _LARGEST_M) / _SMALLEST_M) / np.log(_LARGEST_M / _SMALLEST_M)
        code = np.where(known, 1 + np.ceil(place * _LOG_STEPS), 0)
        drawn = _SMALLEST_M * (_LARGEST_M / _SMALLEST_M) ** ((code - 1) / _LOG_STEPS)
        shares = np.where(known[..., None], np.clip(np.round(127 * factor / drawn[..., None]), -127, 127), 0)
    return _base64(np.concatenate([code[..., None], shares % 256], axis=-1).astype(np.uint8))


def pack_marks(layer: Layer, measured: np.ndarray, frame_indices: np.ndarray) -> np.ndarray:
    """Encode the state of each point and of its detection in each view with two bits each, four to a byte.

    Points: 0 missing, 1 measured, 2 filled or held. Views: 0 no detection, 1 used, 2 rejected or not used.

    Args:
        layer: a range of frames.
        measured: shape (frame, person, keypoint), bool.
        frame_indices: the frames to encode.

    Returns:
        Shape (frame index, person, keypoint, byte), uint8.
    """
    point = encode_point_states(layer, measured)[frame_indices]
    codes = point[..., None]
    view_status = np.asarray(layer.view_status[:])[frame_indices]
    if view_status.shape[-1] <= MARKED_VIEWS:
        codes = np.concatenate([codes, encode_view_states(view_status)], axis=-1)
    n_bytes = -(-codes.shape[-1] // 4)
    padding = 4 * n_bytes - codes.shape[-1]
    groups = np.pad(codes, [(0, 0)] * 3 + [(0, padding)]).reshape(*codes.shape[:-1], n_bytes, 4)
    return (groups << np.array([0, 2, 4, 6])).sum(axis=-1).astype(np.uint8)


def encode_point_states(layer: Layer, measured: np.ndarray) -> np.ndarray:
    """Return 0 for missing, 1 for measured, 2 for filled or held points; shape (frame, person, keypoint), int8."""
    return np.where(layer.has_point, np.where(measured, 1, 2), 0).astype(np.int8)


def encode_view_states(view_status: np.ndarray) -> np.ndarray:
    """Return 0 for no detection, 1 for used, 2 for rejected or not used detections; same shape, int8."""
    undetected = np.isin(view_status, (ViewStatus.UNSEEN, ViewStatus.NOT_RECORDED))
    return np.where(is_used(view_status), 1, np.where(undetected, 0, 2)).astype(np.int8)


def is_measured(layer: Layer) -> np.ndarray:
    """Return which points come from detections of their own frame, shape (frame, person, keypoint), bool."""
    status, source = np.asarray(layer.status[:]), np.asarray(layer.source[:])
    bridged = np.isin(status, (PointStatus.FILLED, PointStatus.HELD)) | (source == Source.FILLED)
    return layer.has_point & ~bridged


def encode_per_person(parts: Sequence[np.ndarray]) -> list[str]:
    """Join consecutive ranges of shape (frame, person, ...) and encode them as base64, one text per person."""
    return [_base64(np.ascontiguousarray(values)) for values in np.concatenate(parts).swapaxes(0, 1)]


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode("ascii")
