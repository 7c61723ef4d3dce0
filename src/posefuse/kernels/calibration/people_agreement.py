"""How well every two people of two views agree with a relative pose, sample by sample."""

import math

import numpy as np

from posefuse.kernels.calibration.relative_pose import STUDENT_T_DOF
from posefuse.kernels.jit import kernel, subroutine

COST, POINTS, BEHIND, DEPTH_A, DEPTH_B, N_RESULTS = 0, 1, 2, 3, 4, 5
"""Sum of the robust costs, number of points, number of those behind a camera, and the mean distances from both cameras
in units of the baseline."""


@subroutine
def _point(rotation, t, a, b, variance_a, variance_b, out):
    """Write the robust cost, the distances from both cameras along the rays, and return whether both rays exist."""
    if not (np.isfinite(a[0]) and np.isfinite(b[0])):
        return False
    rx = rotation[0, 0] * a[0] + rotation[0, 1] * a[1] + rotation[0, 2] * a[2]
    ry = rotation[1, 0] * a[0] + rotation[1, 1] * a[1] + rotation[1, 2] * a[2]
    rz = rotation[2, 0] * a[0] + rotation[2, 1] * a[1] + rotation[2, 2] * a[2]
    # Normals of the planes through the baseline and each ray, in the second camera.
    ax, ay, az = t[1] * rz - t[2] * ry, t[2] * rx - t[0] * rz, t[0] * ry - t[1] * rx
    bx, by, bz = t[1] * b[2] - t[2] * b[1], t[2] * b[0] - t[0] * b[2], t[0] * b[1] - t[1] * b[0]
    error = ax * b[0] + ay * b[1] + az * b[2]
    across_b = ax * ax + ay * ay + az * az - error * error
    across_a = bx * bx + by * by + bz * bz - error * error
    variance = max(variance_b * across_b + variance_a * across_a, 1e-30)
    out[0] = math.log1p(error * error / variance / STUDENT_T_DOF)
    nx, ny, nz = b[1] * rz - b[2] * ry, b[2] * rx - b[0] * rz, b[0] * ry - b[1] * rx
    norm = max(nx * nx + ny * ny + nz * nz, 1e-12)
    out[1] = (bx * nx + by * ny + bz * nz) / norm
    out[2] = (ax * nx + ay * ny + az * nz) / norm
    return True


@kernel
def _seen(rays):
    """Return whether any ray of a person exists, shape (sample, person)."""
    seen = np.zeros((rays.shape[0], rays.shape[1]), dtype=np.bool_)
    for s in range(rays.shape[0]):
        for i in range(rays.shape[1]):
            for k in range(rays.shape[2]):
                seen[s, i] |= np.isfinite(rays[s, i, k, 0])
    return seen


@kernel
def people_agreement(rotation, translation, rays_a, rays_b, variance_a, variance_b, mirror, results):
    """Compare all people of two views under a relative pose, with the sides that agree better in each sample.

    Args:
        rotation: shape (3, 3): second view from first.
        translation: shape (3,): unit vector.
        rays_a: shape (sample, person, keypoint, 3), NaN where missing.
        rays_b: the same of the second view, at the same times.
        variance_a: shape (sample, person, keypoint): variance of a direction per axis, in rad^2.
        variance_b: the same of the second view.
        mirror: shape (keypoint,): keypoint of the opposite side.
        results: shape (sample, person of the first view, person of the second view, N_RESULTS): written.
    """
    out = np.empty(3)
    sums = np.empty(N_RESULTS)
    seen_a = _seen(rays_a)
    seen_b = _seen(rays_b)
    for s in range(rays_a.shape[0]):
        for i in range(rays_a.shape[1]):
            for j in range(rays_b.shape[1]):
                best = math.inf
                results[s, i, j] = 0.0
                if not (seen_a[s, i] and seen_b[s, j]):
                    continue
                for swapped in range(2):
                    sums[:] = 0.0
                    for k in range(len(mirror)):
                        other = mirror[k] if swapped else k
                        a, b = rays_a[s, i, k], rays_b[s, j, other]
                        if _point(rotation, translation, a, b, variance_a[s, i, k], variance_b[s, j, other], out):
                            sums[COST] += out[0]
                            sums[POINTS] += 1.0
                            sums[BEHIND] += 1.0 if out[1] <= 0.0 or out[2] <= 0.0 else 0.0
                            sums[DEPTH_A] += out[1]
                            sums[DEPTH_B] += out[2]
                    if sums[POINTS] > 0.0 and sums[COST] / sums[POINTS] < best:
                        best = sums[COST] / sums[POINTS]
                        results[s, i, j] = sums
                        results[s, i, j, DEPTH_A] /= sums[POINTS]
                        results[s, i, j, DEPTH_B] /= sums[POINTS]
