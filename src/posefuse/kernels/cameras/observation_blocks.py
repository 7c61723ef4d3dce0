"""Blocks of observations: from detection arrays to rows and weights, and from block results to per-view results."""

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
from posefuse.kernels.jit import inline, subroutine


@inline
def index_lanes(first, total, n_keypoints, lane_indices):
    """Write the person-frame and keypoint of each lane of the block that starts at point ``first``.

    Args:
        first: number of the first point, ``person_frame * n_keypoints + keypoint``.
        total: number of points.
        n_keypoints: keypoints per person.
        lane_indices: shape (2, BLOCK), int64, written: person-frame and keypoint; person-frame -1 beyond the last
            point.
    """
    n = first // n_keypoints
    k = first - n * n_keypoints
    for j in range(BLOCK):
        lane_indices[0, j] = n if first + j < total else -1
        lane_indices[1, j] = k
        k += 1
        if k == n_keypoints:
            k = 0
            n += 1


@inline
def load_block(
    keypoints_px, confidence, detection_rows, lane_indices, min_confidence, pixels, block_confidence, view_codes
):
    """Gather the observations of a block.

    Args:
        keypoints_px: shape (detection, keypoint, 2).
        confidence: shape (detection, keypoint), NaN where the detector gives none.
        detection_rows: shape (person_frame, view): rows of ``keypoints_px``, NO_DETECTION or NOT_RECORDED.
        lane_indices: from :func:`index_lanes`.
        min_confidence: keypoints below this confidence are not used.
        pixels: shape (view, 2, BLOCK), written; NaN where there is no observation.
        block_confidence: shape (view, BLOCK), written: the confidence, 1 where the detector gives none.
        view_codes: shape (view, BLOCK), written: VIEW_USED, VIEW_UNSEEN, VIEW_LOW_CONFIDENCE or VIEW_NOT_RECORDED.
    """
    for j in range(BLOCK):
        n = lane_indices[0, j]
        k = lane_indices[1, j]
        for v in range(detection_rows.shape[1]):
            row = detection_rows[n, v] if n >= 0 else status_codes.NO_DETECTION
            if row >= 0:
                pixel_u = keypoints_px[row, k, 0]
                pixel_v = keypoints_px[row, k, 1]
                c = confidence[row, k]
                pixels[v, 0, j] = pixel_u
                pixels[v, 1, j] = pixel_v
                block_confidence[v, j] = c if c == c else 1.0
                finite = math.isfinite(pixel_u + pixel_v)
                code = status_codes.VIEW_LOW_CONFIDENCE if c < min_confidence else status_codes.VIEW_USED
                view_codes[v, j] = code if finite else status_codes.VIEW_UNSEEN
            else:
                pixels[v, 0, j] = math.nan
                pixels[v, 1, j] = math.nan
                block_confidence[v, j] = 1.0
                view_codes[v, j] = (
                    status_codes.VIEW_NOT_RECORDED if row == status_codes.NOT_RECORDED else status_codes.VIEW_UNSEEN
                )


@inline
def compute_weights(scale_px, exponent, block_confidence, lens_codes, view_codes, weights):
    """Compute weights 1 / sigma^2, sigma = scale_px / confidence^exponent; mark pixels outside the lens domain."""
    for v in range(weights.shape[0]):
        base = 1.0 / (scale_px[v] * scale_px[v])
        for j in range(BLOCK):
            usable = (view_codes[v, j] == status_codes.VIEW_USED) & (lens_codes[v, j] == OK)
            weights[v, j] = base if usable else 0.0
        if exponent != 0.0:
            for j in range(BLOCK):
                weights[v, j] *= block_confidence[v, j] ** (2.0 * exponent)
                zero_weight = (
                    (view_codes[v, j] == status_codes.VIEW_USED) & (lens_codes[v, j] == OK) & (not weights[v, j] > 0.0)
                )
                view_codes[v, j] = status_codes.VIEW_LOW_CONFIDENCE if zero_weight else view_codes[v, j]
        for j in range(BLOCK):
            beyond = (view_codes[v, j] == status_codes.VIEW_USED) & (lens_codes[v, j] == BEYOND)
            view_codes[v, j] = status_codes.VIEW_BEYOND_LENS if beyond else view_codes[v, j]


@inline
def reproject_block(cameras, pixels, state, view_errors):
    """Compute reprojection errors in px through the full lens model; NaN where undefined.

    The first three rows of ``state`` are the points. The projection equals that of ``project_point``, one block at a
    time.
    """
    for v in range(pixels.shape[0]):
        if cameras[v, LENS] == PINHOLE:
            _reproject_pinhole(cameras, v, pixels, state, view_errors)
        if cameras[v, LENS] == FISHEYE:
            _reproject_fisheye(cameras, v, pixels, state, view_errors)
        if cameras[v, LENS] != PINHOLE and cameras[v, LENS] != FISHEYE:
            _reproject_distorted(cameras, v, pixels, state, view_errors)


@subroutine
def _reproject_fisheye(cameras, v, pixels, state, view_errors):
    """Reproject a block through a fisheye lens."""
    for j in range(BLOCK):
        x, y, z = to_camera(cameras, v, state[0, j], state[1, j], state[2, j])
        _, pixel_u, pixel_v = project_point(cameras, v, x, y, z)
        view_errors[v, j] = math.sqrt((pixel_u - pixels[v, 0, j]) ** 2 + (pixel_v - pixels[v, 1, j]) ** 2)


@inline
def _reproject_pinhole(cameras, v, pixels, state, view_errors):
    # Read the camera parameters before the loop; inside it they would become masked gathers.
    """Reproject a block through a pinhole camera."""
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


@subroutine
def _reproject_distorted(cameras, v, pixels, state, view_errors):
    """Reproject a block through a lens with distortion polynomials."""
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
def fill_linearized_errors(rows, weights, state, view_errors):
    """Fill in errors of used views whose fold lies before the point, using the lens linearized at the pixel.

    The pixel is inside the domain of the lens model, but the point that all views agree on is just outside of it.
    """
    for v in range(weights.shape[0]):
        n_lost = 0
        for j in range(BLOCK):
            n_lost += 1 if (weights[v, j] > 0.0) & (view_errors[v, j] != view_errors[v, j]) else 0
        if n_lost == 0:
            continue
        for j in range(BLOCK):
            if weights[v, j] > 0.0 and view_errors[v, j] != view_errors[v, j]:
                _, r, s = residual(rows, v, j, state[0, j], state[1, j], state[2, j])
                view_errors[v, j] = math.sqrt(r * r + s * s)


@inline
def store_view_results(view_codes, view_errors, status, lane_indices, out):
    """Write the per-view results of a block, and the mean error over the used views, to a TriangulatedPoints."""
    for j in range(BLOCK):
        n = lane_indices[0, j]
        k = lane_indices[1, j]
        if n < 0:
            continue
        solved = status[j] < status_codes.POINT_MISSING
        total = 0.0
        n_used = 0
        for v in range(view_codes.shape[0]):
            code = view_codes[v, j]
            if code == status_codes.VIEW_USED:
                total += view_errors[v, j]
                n_used += 1
            out.view_codes[n, k, v] = code if solved or code != status_codes.VIEW_USED else status_codes.VIEW_NOT_USED
            out.view_errors_px[n, k, v] = view_errors[v, j] if solved else math.nan
        out.mean_errors_px[n, k] = total / n_used if solved else math.nan
