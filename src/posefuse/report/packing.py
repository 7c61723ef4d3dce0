"""Arrays as the page carries them: small integers in base64, each with what turns it back."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.model.reconstruction import Layer
from posefuse.model.status import PointStatus, Source, ViewStatus, is_used

_STEPS = 32767
_NOWHERE = -32768
_BULK = 0.995
_REACH = 3.0
"""The drawn box is this many times as far from the middle as the bulk of the points."""
_SMALLEST_M, _LARGEST_M = 1e-6, 1e3
_LOG_STEPS = 254
MARKED_VIEWS = 32
"""With more cameras the page does not carry what each made of each point."""


@dataclass(frozen=True)
class Box:
    """What is drawn: numbers as steps from a middle.

    Attributes:
        middle: x, y, z, in the unit of the points.
        step: the length of one step.
    """

    middle: tuple[float, float, float]
    step: float


def box_of(points: np.ndarray) -> Box:
    """The box that holds the bulk of the points and what is about it; strays far out are not worth a coarse step."""
    flat = points.reshape(-1, 3)
    flat = flat[np.isfinite(flat).all(axis=-1)]
    if not len(flat):
        return Box((0.0, 0.0, 0.0), 1e-3)
    middle = np.median(flat, axis=0).astype(np.float64)
    reach = np.abs(flat - middle).max(axis=-1)
    far = min(_REACH * float(np.quantile(reach, _BULK)), float(reach.max())) or 1.0
    x, y, z = (float(value) for value in middle.round(6))
    # A step a little too long keeps the farthest point inside whatever rounding does.
    return Box((x, y, z), float(f"{1.0001 * far / _STEPS:.6g}"))


def packed_points(points: np.ndarray, box: Box) -> tuple[str, int]:
    """Points, shape (..., 3), as base64 of int16 steps, and how many lie outside the box and are left out."""
    with np.errstate(invalid="ignore"):
        steps = np.round((points - np.array(box.middle)) / box.step)
        inside: np.ndarray = np.all(np.abs(steps) <= _STEPS, axis=-1)
    there = np.isfinite(points).all(axis=-1)
    out = np.where(inside[..., None], np.nan_to_num(steps), _NOWHERE).astype("<i2")
    return _base64(out), int((there & ~inside).sum())


def packed_spreads(covariance_m2: np.ndarray) -> str:
    """Covariances, shape (..., 6), as 7 bytes: the size on a logarithmic scale, and Cholesky's factor in shares of it.

    Sizes are rounded up: an ellipsoid is never drawn smaller than it is by more than a hundredth.
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


def packed_marks(layer: Layer, measured: np.ndarray, places: np.ndarray) -> np.ndarray:
    """What became of each point and of each view's part in it, two bits each, four to a byte.

    Of a point: 0 missing, 1 measured, 2 filled or held. Of a view: 0 no detection, 1 used, 2 rejected or not used.

    Args:
        layer: a range of frames.
        measured: shape (frame, person, keypoint), bool.
        places: of the frames to take.

    Returns:
        Shape (place, person, keypoint, byte), uint8.
    """
    point = point_codes(layer, measured)[places]
    codes = point[..., None]
    view_status = np.asarray(layer.view_status[:])[places]
    if view_status.shape[-1] <= MARKED_VIEWS:
        codes = np.concatenate([codes, view_codes(view_status)], axis=-1)
    n_bytes = -(-codes.shape[-1] // 4)
    spare = 4 * n_bytes - codes.shape[-1]
    fours = np.pad(codes, [(0, 0)] * 3 + [(0, spare)]).reshape(*codes.shape[:-1], n_bytes, 4)
    return (fours << np.array([0, 2, 4, 6])).sum(axis=-1).astype(np.uint8)


def point_codes(layer: Layer, measured: np.ndarray) -> np.ndarray:
    """Shape (frame, person, keypoint), int8: 0 missing, 1 measured, 2 filled or held."""
    return np.where(layer.has_point, np.where(measured, 1, 2), 0).astype(np.int8)


def view_codes(view_status: np.ndarray) -> np.ndarray:
    """Codes of the same shape, int8: 0 no detection, 1 used, 2 rejected or not used."""
    lacking = np.isin(view_status, (ViewStatus.UNSEEN, ViewStatus.NOT_RECORDED))
    return np.where(is_used(view_status), 1, np.where(lacking, 0, 2)).astype(np.int8)


def is_measured(layer: Layer) -> np.ndarray:
    """Shape (frame, person, keypoint), bool: points that rest on detections of their own frame."""
    status, source = np.asarray(layer.status[:]), np.asarray(layer.source[:])
    bridged = np.isin(status, (PointStatus.FILLED, PointStatus.HELD)) | (source == Source.FILLED)
    return layer.has_point & ~bridged


def by_person(parts: Sequence[np.ndarray]) -> list[str]:
    """Consecutive ranges, shape (frame, person, ...), as base64 for each person."""
    return [_base64(np.ascontiguousarray(values)) for values in np.concatenate(parts).swapaxes(0, 1)]


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode("ascii")
