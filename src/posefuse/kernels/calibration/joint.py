"""Points of several views and their derivatives by pose, time offset and clock drift of every view."""

import numpy as np

from posefuse.kernels.jit import kernel, subroutine
from posefuse.kernels.linear_algebra.symmetric_3x3 import solve_symmetric

VIEW_PARAMETERS = 8
"""Three rotations about the camera's axes, three shifts of its center, time offset, clock drift."""
FOCAL = 8
"""Index of the logarithm of the focal length, which is a parameter only where it is not known."""
RADIAL = 9
"""Index of the first coefficient of radial distortion, which is a parameter together with the focal length."""
PRINCIPAL = 10
"""Index of the first of two shifts of the principal point, which are parameters together with the distortion."""
_MIN_DEPTH = 0.05
_NEWTON_STEPS, _MIN_STEEPNESS, _EXACT = 8, 0.1, 1e-6


@kernel
def undistort_radial(coefficient, xy, sigma):
    """Invert ``distorted = x (1 + k |x|^2)`` by Newton's method; NaN and noise 0 beyond the fold of the distortion.

    Args:
        coefficient: shape (view,): k.
        xy: shape (point, view, 2): distorted coordinates, NaN where missing; changed.
        sigma: shape (point, view): noise of these; changed to the geometric mean of the noise along and across.
    """
    for n in range(xy.shape[0]):
        for v in range(xy.shape[1]):
            k = coefficient[v]
            if k == 0.0 or not np.isfinite(xy[n, v, 0]):
                continue
            distorted = np.sqrt(xy[n, v, 0] ** 2 + xy[n, v, 1] ** 2)
            r = distorted
            for _ in range(_NEWTON_STEPS):
                r -= (r * (1.0 + k * r * r) - distorted) / max(1.0 + 3.0 * k * r * r, _MIN_STEEPNESS)
            steep, ratio = 1.0 + 3.0 * k * r * r, 1.0 + k * r * r
            if steep < _MIN_STEEPNESS or abs(r * ratio - distorted) > _EXACT:
                xy[n, v, :] = np.nan
                sigma[n, v] = 0.0
                continue
            xy[n, v, 0] /= ratio
            xy[n, v, 1] /= ratio
            sigma[n, v] /= np.sqrt(steep * ratio)


@kernel
def linear_points(xy, rotation, center, points):
    """Triangulate linearly where no starting point is given.

    Args:
        xy: shape (point, view, 2): x/z and y/z, NaN where missing.
        rotation: shape (view, 3, 3): camera_from_world.
        center: shape (view, 3): camera centers.
        points: shape (point, 3), NaN where unknown; written.
    """
    for n in range(xy.shape[0]):
        if np.isfinite(points[n, 0]):
            continue
        seen = 0
        m = np.zeros((3, 3))
        b = np.zeros(3)
        for v in range(xy.shape[1]):
            if not np.isfinite(xy[n, v, 0]):
                continue
            seen += 1
            for axis in range(2):
                offset = 0.0
                norm = 0.0
                for i in range(3):
                    row = rotation[v, axis, i] - xy[n, v, axis] * rotation[v, 2, i]
                    offset += row * center[v, i]
                    norm += row * row
                for i in range(3):
                    row = rotation[v, axis, i] - xy[n, v, axis] * rotation[v, 2, i]
                    b[i] += row * offset / norm
                    for j in range(3):
                        other = rotation[v, axis, j] - xy[n, v, axis] * rotation[v, 2, j]
                        m[i, j] += row * other / norm
        if seen < 2:
            continue
        ok, x, y, z = solve_symmetric(m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2], b[0], b[1], b[2])
        if ok:
            points[n, 0] = x
            points[n, 1] = y
            points[n, 2] = z


@kernel
def refine_points(xy, sigma, rotation, center, dof, steps, points):
    """Refine points by reweighted Gauss-Newton steps with Student-t weights; failures become NaN.

    Args:
        xy: shape (point, view, 2): x/z and y/z, NaN where missing.
        sigma: shape (point, view): noise in that plane.
        rotation: shape (view, 3, 3): camera_from_world.
        center: shape (view, 3): camera centers.
        dof: degrees of freedom of the Student-t distribution.
        steps: number of steps.
        points: shape (point, 3): starting points; written.
    """
    for n in range(xy.shape[0]):
        for _ in range(steps):
            if not np.isfinite(points[n, 0]):
                break
            m = np.zeros((3, 3))
            b = np.zeros(3)
            seen = 0
            row = np.zeros((2, 3))
            for v in range(xy.shape[1]):
                if not (np.isfinite(xy[n, v, 0]) and sigma[n, v] > 0.0):
                    continue
                px = points[n, 0] - center[v, 0]
                py = points[n, 1] - center[v, 1]
                pz = points[n, 2] - center[v, 2]
                x = rotation[v, 0, 0] * px + rotation[v, 0, 1] * py + rotation[v, 0, 2] * pz
                y = rotation[v, 1, 0] * px + rotation[v, 1, 1] * py + rotation[v, 1, 2] * pz
                z = rotation[v, 2, 0] * px + rotation[v, 2, 1] * py + rotation[v, 2, 2] * pz
                if z < _MIN_DEPTH:
                    continue
                seen += 1
                scale = 1.0 / (z * sigma[n, v])
                ru = (xy[n, v, 0] - x / z) / sigma[n, v]
                rv = (xy[n, v, 1] - y / z) / sigma[n, v]
                weight = (dof + 2.0) / (dof + ru * ru + rv * rv)
                for i in range(3):
                    row[0, i] = scale * (rotation[v, 0, i] - x / z * rotation[v, 2, i])
                    row[1, i] = scale * (rotation[v, 1, i] - y / z * rotation[v, 2, i])
                for i in range(3):
                    b[i] += weight * (row[0, i] * ru + row[1, i] * rv)
                    for j in range(3):
                        m[i, j] += weight * (row[0, i] * row[0, j] + row[1, i] * row[1, j])
            ok, x, y, z = solve_symmetric(m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2], b[0], b[1], b[2])
            if seen < 2 or not ok:
                points[n, :] = np.nan
                break
            points[n, 0] += x
            points[n, 1] += y
            points[n, 2] += z


@kernel
def joint_rows(xy, sigma, cameras, points, motion, residual, by_view, by_point):
    """Compute residuals and their derivatives, in units of the noise; zero where a view does not observe a point.

    Args:
        xy: shape (point, view, 2): x/z and y/z, NaN where missing.
        sigma: shape (point, view): noise in that plane.
        cameras: rotations, shape (view, 3, 3), centers, shape (view, 3), and lenses, shape (view, 2): radial
            distortion, and size of the ideal image plane relative to that of the recording.
        points: shape (point, 3), NaN where unknown.
        motion: velocities in m/s, shape (point, 3), and time since the middle of the recording, shape (point,).
        residual: shape (point, view, 2), written: observed minus projected.
        by_view: shape (point, view, 2, VIEW_PARAMETERS), or four more with the lens, written.
        by_point: shape (point, view, 2, 3), written.
    """
    rotation, center, lens = cameras
    velocity, time_s = motion
    for n in range(xy.shape[0]):
        seen = 0
        for v in range(xy.shape[1]):
            if np.isfinite(xy[n, v, 0]) and sigma[n, v] > 0.0:
                seen += 1
        for v in range(xy.shape[1]):
            residual[n, v] = 0.0
            by_view[n, v] = 0.0
            by_point[n, v] = 0.0
            if seen < 2 or not (np.isfinite(xy[n, v, 0]) and sigma[n, v] > 0.0 and np.isfinite(points[n, 0])):
                continue
            px = points[n, 0] - center[v, 0]
            py = points[n, 1] - center[v, 1]
            pz = points[n, 2] - center[v, 2]
            x = rotation[v, 0, 0] * px + rotation[v, 0, 1] * py + rotation[v, 0, 2] * pz
            y = rotation[v, 1, 0] * px + rotation[v, 1, 1] * py + rotation[v, 1, 2] * pz
            z = rotation[v, 2, 0] * px + rotation[v, 2, 1] * py + rotation[v, 2, 2] * pz
            if z < _MIN_DEPTH:
                continue
            scale = 1.0 / (z * sigma[n, v])
            residual[n, v, 0] = (xy[n, v, 0] - x / z) / sigma[n, v]
            residual[n, v, 1] = (xy[n, v, 1] - y / z) / sigma[n, v]
            for axis in range(2):
                slope = x / z if axis == 0 else y / z
                first = scale if axis == 0 else 0.0
                second = 0.0 if axis == 0 else scale
                third = -scale * slope
                # d(exp(w) x)/dw = -[x]x, so a row j of the derivative becomes x cross j.
                by_view[n, v, axis, 0] = y * third - z * second
                by_view[n, v, axis, 1] = z * first - x * third
                by_view[n, v, axis, 2] = x * second - y * first
                moving = 0.0
                for i in range(3):
                    row = first * rotation[v, 0, i] + second * rotation[v, 1, i] + third * rotation[v, 2, i]
                    by_point[n, v, axis, i] = row
                    by_view[n, v, axis, 3 + i] = -row
                    moving += row * velocity[n, i]
                by_view[n, v, axis, 6] = moving
                by_view[n, v, axis, 7] = moving * time_s[n]
                if by_view.shape[3] > FOCAL:
                    squared = (x * x + y * y) / (z * z)
                    radial = lens[v, 0]
                    steep, ratio = 1.0 + 3.0 * radial * squared, 1.0 + radial * squared
                    by_view[n, v, axis, FOCAL] = slope * ratio / (steep * sigma[n, v])
                    by_view[n, v, axis, RADIAL] = slope * squared / (steep * sigma[n, v])
                    if by_view.shape[3] > PRINCIPAL:
                        shrink = lens[v, 1] / (ratio * sigma[n, v])
                        bent = -2.0 * radial * slope * shrink / (steep * z)
                        by_view[n, v, axis, PRINCIPAL] = bent * x + (shrink if axis == 0 else 0.0)
                        by_view[n, v, axis, PRINCIPAL + 1] = bent * y + (shrink if axis == 1 else 0.0)


@kernel
def decaying_sums(rows, decay, out):
    """Sum rows with exponentially decaying weights: out[t] = rows[t] + decay[t] * out[t - 1].

    Args:
        rows: shape (time, stream, parameter).
        decay: shape (time,); the first is not used.
        out: shape (time, stream, parameter), written.
    """
    for t in range(rows.shape[0]):
        for s in range(rows.shape[1]):
            for p in range(rows.shape[2]):
                before = decay[t] * out[t - 1, s, p] if t > 0 else 0.0
                out[t, s, p] = rows[t, s, p] + before


@subroutine
def _bends(a, b, x, g, bend, turn):
    """Write gradient and second derivative of ``a x/z + b y/z``, and the derivative of a point by a rotation."""
    z = x[2]
    g[0] = a / z
    g[1] = b / z
    g[2] = -(a * x[0] + b * x[1]) / (z * z)
    bend[:] = 0.0
    bend[0, 2] = bend[2, 0] = -a / (z * z)
    bend[1, 2] = bend[2, 1] = -b / (z * z)
    bend[2, 2] = 2.0 * (a * x[0] + b * x[1]) / (z * z * z)
    turn[0, 0] = turn[1, 1] = turn[2, 2] = 0.0
    turn[0, 1], turn[0, 2], turn[1, 2] = x[2], -x[1], x[0]
    turn[1, 0], turn[2, 0], turn[2, 1] = -x[2], x[1], -x[0]


@subroutine
def _inner_derivatives(x, g, bend, turn, inner):
    """Write second derivatives by a rotation w and a shift d: x(w, d) = x + w x x + d + w x (w x x) / 2 + w x d."""
    dot = g[0] * x[0] + g[1] * x[1] + g[2] * x[2]
    for i in range(3):
        for j in range(3):
            inner[i, j] = 0.5 * (g[i] * x[j] + x[i] * g[j]) - (dot if i == j else 0.0)
            inner[3 + i, 3 + j] = bend[i, j]
            mixed = 0.0
            for k in range(3):
                mixed += turn[k, i] * bend[k, j]
                for m in range(3):
                    inner[i, j] += turn[k, i] * bend[k, m] * turn[m, j]
            inner[i, 3 + j] = mixed
    # w . (d x g) = -w . [g]x d
    inner[0, 4] += g[2]
    inner[0, 5] -= g[1]
    inner[1, 3] -= g[2]
    inner[1, 5] += g[0]
    inner[2, 3] += g[1]
    inner[2, 4] -= g[0]
    for i in range(3):
        for j in range(3):
            inner[3 + j, i] = inner[i, 3 + j]


@subroutine
def _parameter_steps(rotation, velocity, time_s, step):
    """Write the derivatives of rotation and shift by the view's parameters, then by the point, shape (6, 11)."""
    step[:] = 0.0
    for i in range(3):
        step[i, i] = 1.0
        for j in range(3):
            step[3 + i, 3 + j] = -rotation[i, j]
            step[3 + i, 8 + j] = rotation[i, j]
            step[3 + i, 6] += rotation[i, j] * velocity[j]
        step[3 + i, 7] = step[3 + i, 6] * time_s


@subroutine
def _products(inner, step, half, whole):
    """Write ``step^T inner step``, shape (11, 11)."""
    for i in range(6):
        for p in range(11):
            half[i, p] = 0.0
            for j in range(6):
                half[i, p] += inner[i, j] * step[j, p]
    for p in range(11):
        for q in range(11):
            whole[p, q] = 0.0
            for i in range(6):
                whole[p, q] += step[i, p] * half[i, q]


@kernel
def second_derivatives(scores, sigma, cameras, points, motion, by_view, coupling, by_point):
    """Subtract the second derivatives of the projections, weighted by the scores.

    The residual is observed minus projected, so the cost's second derivative contains them with the opposite sign.

    Args:
        scores: shape (point, view, 2): weighted residuals in units of the noise, 0 where they do not count.
        sigma: shape (point, view): noise in the normalized image plane.
        cameras: rotations, shape (view, 3, 3), and centers, shape (view, 3).
        points: shape (point, 3).
        motion: velocities in m/s, shape (point, 3), and time since the middle of the recording, shape (point,).
        by_view: shape (view, VIEW_PARAMETERS, VIEW_PARAMETERS), changed.
        coupling: shape (point, 3, view, VIEW_PARAMETERS), changed.
        by_point: shape (point, 3, 3), changed.
    """
    rotation, center = cameras
    velocity, time_s = motion
    bend, turn, inner = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((6, 6))
    step, half, whole = np.zeros((6, 11)), np.zeros((6, 11)), np.zeros((11, 11))
    x, g = np.zeros(3), np.zeros(3)
    for n in range(scores.shape[0]):
        for v in range(scores.shape[1]):
            if scores[n, v, 0] == 0.0 and scores[n, v, 1] == 0.0:
                continue
            for i in range(3):
                x[i] = 0.0
                for j in range(3):
                    x[i] += rotation[v, i, j] * (points[n, j] - center[v, j])
            _bends(scores[n, v, 0] / sigma[n, v], scores[n, v, 1] / sigma[n, v], x, g, bend, turn)
            _inner_derivatives(x, g, bend, turn, inner)
            _parameter_steps(rotation[v], velocity[n], time_s[n], step)
            _products(inner, step, half, whole)
            for q in range(VIEW_PARAMETERS):
                for p in range(VIEW_PARAMETERS):
                    by_view[v, p, q] -= whole[p, q]
                for p in range(3):
                    coupling[n, p, v, q] -= whole[8 + p, q]
            for p in range(3):
                for q in range(3):
                    by_point[n, p, q] -= whole[8 + p, 8 + q]
