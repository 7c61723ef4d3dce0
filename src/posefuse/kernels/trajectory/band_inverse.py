"""Blocks of the inverse of the systems of :mod:`posefuse.kernels.trajectory.band` within the band.

They follow from the factor alone, last frame first (K. Takahashi et al. 1973; Erisman & Tinney, "On computing certain
elements of the inverse of a sparse matrix", Communications of the ACM 18, 1975).
"""

import numpy as np

from posefuse.kernels.jit import disjoint, inline, kernel
from posefuse.kernels.trajectory.band import (
    COUPLING_2,
    COUPLING_3,
    INVERSE,
    LANES,
    REACH,
    store,
    times_matrix,
    times_symmetric,
)

# Rows of the recursion: the first three blocks are the diagonal ones of the three later frames, nearest first; the
# others couple the second of these frames with the first, and the third with the first and the second.
_STATE_ROWS = 54

# Rows of the blocks of U that couple a frame with the second one after, 3x3, and with the third one, symmetric.
_THIRD = 9
_FAR_ROWS = 15

# Rows of a frame: its own block, and the traces of the blocks that couple it with itself and the next three frames.
_TRACES = 6
_OUT_ROWS = 10


@inline
def _coupled_row(state, a, b, c, b_step, c_step, near, far, j):
    """Return a row of a block that couples a later frame with the current one, up to the sign.

    It is the product of the factors and of three rows or columns of the later blocks, given by the place of their first
    number and the distance of the next ones.
    """
    a0, a1, a2 = times_matrix(state[a], state[a + LANES], state[a + 2 * LANES], near, 0 * LANES + j)
    b0, b1, b2 = times_matrix(state[b], state[b + b_step], state[b + 2 * b_step], far, 0 * LANES + j)
    c0, c1, c2 = times_symmetric(state[c], state[c + c_step], state[c + 2 * c_step], far, _THIRD * LANES + j)
    return a0 + b0 + c0, a1 + b1 + c1, a2 + b2 + c2


@disjoint
def _couple_far_frames(own, second, third, far):
    """Compute the blocks of U that couple a frame with the second and the third one after.

    Args:
        own: shape (FACTOR_ROWS * LANES,): factor of the frame.
        second: of the second frame after.
        third: of the third frame after.
        far: shape (_FAR_ROWS * LANES,), written.
    """
    for j in range(LANES):
        c2 = second[COUPLING_2 * LANES + j]
        c3 = second[COUPLING_3 * LANES + j]
        for i in range(3):
            x = -c3 * own[i * LANES + j]
            y = -c3 * own[(3 + i) * LANES + j]
            z = -c3 * own[(6 + i) * LANES + j]
            x = x + c2 if i == 0 else x
            y = y + c2 if i == 1 else y
            z = z + c2 if i == 2 else z
            a0, a1, a2 = times_symmetric(x, y, z, own, INVERSE * LANES + j)
            store(a0, a1, a2, 3 * i * LANES + j, far)
        c3 = third[COUPLING_3 * LANES + j]
        for i in range(6):
            far[(_THIRD + i) * LANES + j] = c3 * own[(INVERSE + i) * LANES + j]


@disjoint
def _invert_frame(own, near, far, state, out):
    """Compute the blocks of the inverse of one frame of a tile.

    Args:
        own: shape (FACTOR_ROWS * LANES,): factor of the frame.
        near: of the frame after.
        far: shape (_FAR_ROWS * LANES,): blocks of U that couple the frame with the second and the third one after.
        state: shape (_STATE_ROWS * LANES,), in and out: blocks of the inverse of the three later frames.
        out: shape (_OUT_ROWS * LANES,), written.
    """
    for j in range(LANES):
        # Blocks x, y, z of the inverse couple the next three frames with this one, up to the sign.
        x00, x01, x02 = _coupled_row(
            state, 0 * LANES + j, 27 * LANES + j, 36 * LANES + j, 3 * LANES, 3 * LANES, near, far, j
        )
        x10, x11, x12 = _coupled_row(
            state, 3 * LANES + j, 28 * LANES + j, 37 * LANES + j, 3 * LANES, 3 * LANES, near, far, j
        )
        x20, x21, x22 = _coupled_row(
            state, 6 * LANES + j, 29 * LANES + j, 38 * LANES + j, 3 * LANES, 3 * LANES, near, far, j
        )
        y00, y01, y02 = _coupled_row(
            state, 27 * LANES + j, 9 * LANES + j, 45 * LANES + j, 1 * LANES, 3 * LANES, near, far, j
        )
        y10, y11, y12 = _coupled_row(
            state, 30 * LANES + j, 12 * LANES + j, 46 * LANES + j, 1 * LANES, 3 * LANES, near, far, j
        )
        y20, y21, y22 = _coupled_row(
            state, 33 * LANES + j, 15 * LANES + j, 47 * LANES + j, 1 * LANES, 3 * LANES, near, far, j
        )
        z00, z01, z02 = _coupled_row(
            state, 36 * LANES + j, 45 * LANES + j, 18 * LANES + j, 1 * LANES, 1 * LANES, near, far, j
        )
        z10, z11, z12 = _coupled_row(
            state, 39 * LANES + j, 48 * LANES + j, 21 * LANES + j, 1 * LANES, 1 * LANES, near, far, j
        )
        z20, z21, z22 = _coupled_row(
            state, 42 * LANES + j, 51 * LANES + j, 24 * LANES + j, 1 * LANES, 1 * LANES, near, far, j
        )
        a0, a1, a2 = times_matrix(x00, x10, x20, near, 0 * LANES + j)
        b0, b1, b2 = times_matrix(y00, y10, y20, far, 0 * LANES + j)
        c0, c1, c2 = times_symmetric(z00, z10, z20, far, _THIRD * LANES + j)
        xx = own[INVERSE * LANES + j] + (a0 + b0 + c0)
        xy = own[(INVERSE + 1) * LANES + j] + (a1 + b1 + c1)
        xz = own[(INVERSE + 2) * LANES + j] + (a2 + b2 + c2)
        _, a1, a2 = times_matrix(x01, x11, x21, near, 0 * LANES + j)
        _, b1, b2 = times_matrix(y01, y11, y21, far, 0 * LANES + j)
        _, c1, c2 = times_symmetric(z01, z11, z21, far, _THIRD * LANES + j)
        yy = own[(INVERSE + 3) * LANES + j] + (a1 + b1 + c1)
        yz = own[(INVERSE + 4) * LANES + j] + (a2 + b2 + c2)
        _, _, a2 = times_matrix(x02, x12, x22, near, 0 * LANES + j)
        _, _, b2 = times_matrix(y02, y12, y22, far, 0 * LANES + j)
        _, _, c2 = times_symmetric(z02, z12, z22, far, _THIRD * LANES + j)
        zz = own[(INVERSE + 5) * LANES + j] + (a2 + b2 + c2)
        # The second frame becomes the third, the first the second, and this one the first.
        for i in range(9):
            state[(18 + i) * LANES + j] = state[(9 + i) * LANES + j]
            state[(9 + i) * LANES + j] = state[i * LANES + j]
            state[(45 + i) * LANES + j] = state[(27 + i) * LANES + j]
        store(xx, xy, xz, 0 * LANES + j, state)
        store(xy, yy, yz, 3 * LANES + j, state)
        store(xz, yz, zz, 6 * LANES + j, state)
        store(-x00, -x01, -x02, 27 * LANES + j, state)
        store(-x10, -x11, -x12, 30 * LANES + j, state)
        store(-x20, -x21, -x22, 33 * LANES + j, state)
        store(-y00, -y01, -y02, 36 * LANES + j, state)
        store(-y10, -y11, -y12, 39 * LANES + j, state)
        store(-y20, -y21, -y22, 42 * LANES + j, state)
        store(xx, xy, xz, 0 * LANES + j, out)
        store(yy, yz, zz, 3 * LANES + j, out)
        store(xx + yy + zz, -(x00 + x11 + x22), -(y00 + y11 + y22), _TRACES * LANES + j, out)
        out[(_TRACES + 3) * LANES + j] = -(z00 + z11 + z22)


@kernel
def invert_paths(factor, tiles, covariance, traces):
    """Compute the inverse within the band.

    Args:
        factor: from :func:`factor_paths`.
        tiles: shape (tile, LANES), int64: keypoints; -1 where a lane is not used.
        covariance: shape (keypoint, frame, 3, 3), written: blocks on the diagonal.
        traces: shape (keypoint, REACH + 1, frame), written: traces of the blocks that couple each frame with itself and
            with the next three frames; undefined where there is no such frame.
    """
    state = np.empty(_STATE_ROWS * LANES)
    out = np.empty(_OUT_ROWS * LANES)
    far = np.empty(_FAR_ROWS * LANES)
    for t in range(tiles.shape[0]):
        for i in range(_STATE_ROWS * LANES):
            state[i] = 0.0
        for f in range(covariance.shape[1] - 1, -1, -1):
            own = factor[t, REACH + f]
            _couple_far_frames(own, factor[t, REACH + f + 2], factor[t, REACH + f + 3], far)
            _invert_frame(own, factor[t, REACH + f + 1], far, state, out)
            for j in range(LANES):
                k = tiles[t, j]
                if k >= 0:
                    xy = out[LANES + j]
                    xz = out[2 * LANES + j]
                    yz = out[4 * LANES + j]
                    covariance[k, f, 0, 0] = out[j]
                    covariance[k, f, 0, 1] = xy
                    covariance[k, f, 0, 2] = xz
                    covariance[k, f, 1, 0] = xy
                    covariance[k, f, 1, 1] = out[3 * LANES + j]
                    covariance[k, f, 1, 2] = yz
                    covariance[k, f, 2, 0] = xz
                    covariance[k, f, 2, 1] = yz
                    covariance[k, f, 2, 2] = out[5 * LANES + j]
                    for m in range(REACH + 1):
                        traces[k, m, f] = out[(_TRACES + m) * LANES + j]
