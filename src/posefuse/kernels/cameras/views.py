"""Blocks of observations: from the columns of the detections to rows and weights, and back to per-view results."""

import math

from posefuse.kernels import status_codes
from posefuse.kernels.cameras.lens import (
    BEYOND,
    CX,
    CY,
    FISHEYE,
    FX,
    FY,
    LENS,
    MAX_RADIUS,
    OK,
    PINHOLE,
    SKEW,
    distort,
    project_point,
    to_camera,
)
from posefuse.kernels.cameras.observation_rows import BLOCK, residual
from posefuse.kernels.jit import choice, inline


@inline
def locate_lanes(first, total, n_keypoints, places):
    """Which person-frame and keypoint each lane of the block that starts at point ``first`` holds.

    Args:
        first: number of the first point, ``person_frame * n_keypoints + keypoint``.
        total: number of points there are.
        n_keypoints: keypoints of a person.
        places: shape (2, BLOCK), int64, written: person-frame and keypoint; person-frame -1 past the last point.
    """
    n = first // n_keypoints
    k = first - n * n_keypoints
    for j in range(BLOCK):
        places[0, j] = n if first + j < total else -1
        places[1, j] = k
        k += 1
        if k == n_keypoints:
            k = 0
            n += 1


@inline
def load_block(keypoints_px, confidence, rows_of, places, min_confidence, pixels, trust, view_codes):
    """Gather the observations of a block.

    Args:
        keypoints_px: shape (detection, keypoint, 2).
        confidence: shape (detection, keypoint), NaN where the detector gives none.
        rows_of: shape (person_frame, view), rows of ``keypoints_px``, or NO_DETECTION or NOT_RECORDED.
        places: from :func:`locate_lanes`.
        min_confidence: less is not used.
        pixels: shape (view, 2, BLOCK), written; NaN where there is no observation.
        trust: shape (view, BLOCK), written: the confidence, 1 where the detector gives none.
        view_codes: shape (view, BLOCK), written: VIEW_USED, VIEW_UNSEEN, VIEW_LOW_CONFIDENCE or VIEW_NOT_RECORDED.
    """
    for j in range(BLOCK):
        n = places[0, j]
        k = places[1, j]
        for v in range(rows_of.shape[1]):
            row = rows_of[n, v] if n >= 0 else status_codes.NO_DETECTION
            if row >= 0:
                pixel_u = keypoints_px[row, k, 0]
                pixel_v = keypoints_px[row, k, 1]
                c = confidence[row, k]
                pixels[v, 0, j] = pixel_u
                pixels[v, 1, j] = pixel_v
                trust[v, j] = c if c == c else 1.0
                seen = math.isfinite(pixel_u + pixel_v)
                code = status_codes.VIEW_LOW_CONFIDENCE if c < min_confidence else status_codes.VIEW_USED
                view_codes[v, j] = code if seen else status_codes.VIEW_UNSEEN
            else:
                pixels[v, 0, j] = math.nan
                pixels[v, 1, j] = math.nan
                trust[v, j] = 1.0
                view_codes[v, j] = (
                    status_codes.VIEW_NOT_RECORDED if row == status_codes.NOT_RECORDED else status_codes.VIEW_UNSEEN
                )


@inline
def weigh_block(scale_px, exponent, trust, lens_codes, view_codes, weights):
    """Weights 1 / sigma^2 with sigma = scale_px / confidence^exponent; what the lens cannot see is marked."""
    for v in range(weights.shape[0]):
        base = 1.0 / (scale_px[v] * scale_px[v])
        for j in range(BLOCK):
            usable = (view_codes[v, j] == status_codes.VIEW_USED) & (lens_codes[v, j] == OK)
            weights[v, j] = base if usable else 0.0
        if exponent != 0.0:
            for j in range(BLOCK):
                weights[v, j] *= trust[v, j] ** (2.0 * exponent)
                silent = (
                    (view_codes[v, j] == status_codes.VIEW_USED) & (lens_codes[v, j] == OK) & (not weights[v, j] > 0.0)
                )
                view_codes[v, j] = status_codes.VIEW_LOW_CONFIDENCE if silent else view_codes[v, j]
        for j in range(BLOCK):
            beyond = (view_codes[v, j] == status_codes.VIEW_USED) & (lens_codes[v, j] == BEYOND)
            view_codes[v, j] = status_codes.VIEW_BEYOND_LENS if beyond else view_codes[v, j]


@choice
def reproject_block(cameras, distorted, fisheye, pixels, state, view_errors):
    """Distances in px between observed and projected pixels, through the whole lens model; NaN where there is none.

    The first three rows of ``state`` are the points. The same projection as ``project_point``, a block at a time.
    """
    for v in range(pixels.shape[0]):
        if cameras[v, LENS] == PINHOLE:
            _reproject_pinhole(cameras, v, pixels, state, view_errors)
        if fisheye is not None and cameras[v, LENS] == FISHEYE:
            _reproject_fisheye(cameras, v, pixels, state, view_errors)
        if distorted is not None and cameras[v, LENS] != PINHOLE and cameras[v, LENS] != FISHEYE:
            _reproject_distorted(cameras, v, pixels, state, view_errors)


@inline
def _reproject_fisheye(cameras, v, pixels, state, view_errors):
    for j in range(BLOCK):
        x, y, z = to_camera(cameras, v, state[0, j], state[1, j], state[2, j])
        _, pixel_u, pixel_v = project_point(cameras, v, x, y, z)
        view_errors[v, j] = math.sqrt((pixel_u - pixels[v, 0, j]) ** 2 + (pixel_v - pixels[v, 1, j]) ** 2)


@inline
def _reproject_pinhole(cameras, v, pixels, state, view_errors):
    # The camera's numbers are read before the loop: inside it they would be gathered under the mask of z > 0.
    fx = cameras[v, FX]
    fy = cameras[v, FY]
    cx = cameras[v, CX]
    cy = cameras[v, CY]
    skew = cameras[v, SKEW]
    for j in range(BLOCK):
        x, y, z = to_camera(cameras, v, state[0, j], state[1, j], state[2, j])
        inverse = 1.0 / z
        du = (fx * x + skew * y) * inverse + cx - pixels[v, 0, j]
        dv = fy * y * inverse + cy - pixels[v, 1, j]
        error = math.sqrt(du * du + dv * dv)
        view_errors[v, j] = error if z > 0.0 else math.nan


@inline
def _reproject_distorted(cameras, v, pixels, state, view_errors):
    limit = cameras[v, MAX_RADIUS] ** 2
    fx = cameras[v, FX]
    fy = cameras[v, FY]
    cx = cameras[v, CX]
    cy = cameras[v, CY]
    skew = cameras[v, SKEW]
    for j in range(BLOCK):
        x, y, z = to_camera(cameras, v, state[0, j], state[1, j], state[2, j])
        inverse = 1.0 / z
        x_n = x * inverse
        y_n = y * inverse
        x_d, y_d, a, b, c, d = distort(cameras, v, x_n, y_n)
        du = fx * x_d + skew * y_d + cx - pixels[v, 0, j]
        dv = fy * y_d + cy - pixels[v, 1, j]
        error = math.sqrt(du * du + dv * dv)
        visible = (z > 0.0) & (x_n * x_n + y_n * y_n <= limit) & (a * d - b * c > 0.0)
        view_errors[v, j] = error if visible else math.nan


@inline
def linear_errors(rows, weights, state, view_errors):
    """Errors of used views past whose fold the point came to lie: of the lens as linearised at the pixel.

    The pixel was within the lens model's domain, the point that all views agree on is just outside of it.
    """
    for v in range(weights.shape[0]):
        lost = 0
        for j in range(BLOCK):
            lost += 1 if (weights[v, j] > 0.0) & (view_errors[v, j] != view_errors[v, j]) else 0
        if lost == 0:
            continue
        for j in range(BLOCK):
            if weights[v, j] > 0.0 and view_errors[v, j] != view_errors[v, j]:
                _, r, s = residual(rows, v, j, state[0, j], state[1, j], state[2, j])
                view_errors[v, j] = math.sqrt(r * r + s * s)


@inline
def store_view_results(view_codes, view_errors, status, places, out_view_codes, out_view_errors, out_mean_errors):
    """Write the per-view results of a block, and the mean error over the used views of each point."""
    for j in range(BLOCK):
        n = places[0, j]
        k = places[1, j]
        if n < 0:
            continue
        solved = status[j] < status_codes.POINT_MISSING
        total = 0.0
        used = 0
        for v in range(view_codes.shape[0]):
            code = view_codes[v, j]
            if code == status_codes.VIEW_USED:
                total += view_errors[v, j]
                used += 1
            out_view_codes[n, k, v] = code if solved or code != status_codes.VIEW_USED else status_codes.VIEW_NOT_USED
            out_view_errors[n, k, v] = view_errors[v, j] if solved else math.nan
        out_mean_errors[n, k] = total / used if solved else math.nan
