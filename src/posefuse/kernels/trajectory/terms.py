"""What views, smoothness and bones say of the paths of keypoints: the terms of one system for all of them.

First axis is the keypoint, then the frame. The band's layout is that of :mod:`posefuse.kernels.trajectory.band`; what
joins two keypoints, the bones, is kept apart as one direction and one weight per bone and frame.
"""

import math

import numpy as np

from posefuse.kernels.jit import dense, inline, kernel
from posefuse.kernels.trajectory.band import REACH, invert_3, solve_path, times_path

_IN_TOUCH = 0.5
"""An observation that counts less says nothing of how the next one errs."""

_LOOSE = 1e-7
"""Directions in which a point is not seen: as if seen with this share of its information."""


_MOST_LENIENT = 10.0
"""How much the path's own uncertainty may count, in squared sigmas of a detection."""


@kernel
def weigh(residuals, jacobians, sigma, covariance, full, none, weights):
    """Weights of observations by how far they lie from the path: 1 up to ``full`` sigmas, 0 from ``none`` on.

    Where the path is not known as well as a detection, that counts too: its covariance, as the view sees it, up to a
    bound: where nothing is known of a path, nothing tells right views from wrong ones either.

    Args:
        residuals: shape (point, view, 2), px, NaN where there is none.
        jacobians: shape (point, view, 2, 3).
        sigma: shape (point, view), px, inf where an observation does not count.
        covariance: shape (point, 3, 3).
        full: in sigmas.
        none: in sigmas.
        weights: shape (point, view), written.
    """
    full_squared = full * full
    fall = 1.0 / (none * none - full_squared)
    for n in range(residuals.shape[0]):
        for v in range(residuals.shape[1]):
            s = sigma[n, v]
            x = residuals[n, v, 0]
            y = residuals[n, v, 1]
            a = _spread(jacobians[n, v, 0], covariance[n], jacobians[n, v, 0])
            b = _spread(jacobians[n, v, 0], covariance[n], jacobians[n, v, 1])
            c = _spread(jacobians[n, v, 1], covariance[n], jacobians[n, v, 1])
            bound = _MOST_LENIENT * s * s
            share = bound / (a + c) if a + c > bound else 1.0
            a = share * a + s * s
            b = share * b
            c = share * c + s * s
            squared = (c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b)
            weight = min(1.0 - (squared - full_squared) * fall, 1.0)
            # Comparisons with NaN are false: nothing seen, no weight.
            weights[n, v] = weight if weight > 0.0 and s < math.inf else 0.0


@inline
def _spread(first, matrix, second):
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += first[i] * matrix[i, j] * second[j]
    return total


@kernel
def renew_errors(residuals, sigma, used, kept, squares, counts):
    """What of each error is new, not left over from the last one seen: squared, in sigmas.

    Args:
        residuals: shape (keypoint, frame, view, 2), px.
        sigma: shape (keypoint, frame, view), px.
        used: shape (keypoint, frame, view): more than 0 where an error counts.
        kept: shape (frame,): the correlation of an error with that of the frame before.
        squares: shape (keypoint, frame, view), written: of both axes, over what is expected of one; 0 without.
        counts: the same shape, written: how many numbers that is of, 2 or 0.
    """
    for k in range(residuals.shape[0]):
        for v in range(residuals.shape[2]):
            last = -1
            shared = 1.0
            for f in range(residuals.shape[1]):
                shared *= kept[f]
                squares[k, f, v] = 0.0
                counts[k, f, v] = 0.0
                if not used[k, f, v] > 0.0:
                    continue
                x = residuals[k, f, v, 0] / sigma[k, f, v]
                y = residuals[k, f, v, 1] / sigma[k, f, v]
                c = 0.0
                if last >= 0 and f - last <= REACH:
                    c = shared
                    x -= c * residuals[k, last, v, 0] / sigma[k, last, v]
                    y -= c * residuals[k, last, v, 1] / sigma[k, last, v]
                squares[k, f, v] = (x * x + y * y) / (1.0 - c * c)
                counts[k, f, v] = 2.0
                last = f
                shared = 1.0


@inline
def _add_outer(first, second, factor, out):
    """``out += factor first^T second`` of two observations' derivatives, 2 x 3 each."""
    for i in range(3):
        for j in range(3):
            out[i, j] += factor * (first[0, i] * second[0, j] + first[1, i] * second[1, j])


@inline
def _add_pull(jacobian, x, y, factor, out):
    for i in range(3):
        out[i] += factor * (jacobian[0, i] * x + jacobian[1, i] * y)


@dense
def add_view(residuals, jacobians, sigma, weights, kept, v, band, pull, seen, scaled):
    """Add what one view saw of a keypoint, each error following from the last one seen (an autoregression).

    Args:
        residuals: shape (frame, view, 2), px, of projected less observed.
        jacobians: shape (frame, view, 2, 3).
        sigma: shape (frame, view), px.
        weights: shape (frame, view).
        kept: shape (frame,): the correlation of an error with that of the frame before.
        v: the view.
        band: shape (frame, REACH + 1, 3, 3), added to.
        pull: shape (frame, 3), added to: minus the gradient.
        seen: shape (frame, 3, 3), added to: information of each frame as it counts over many.
        scaled: shape (2, 2, 4): room, of the last frame and of this one.
    """
    last = -1
    last_weight = 0.0
    shared = 1.0
    now = 0
    for f in range(residuals.shape[0]):
        shared *= kept[f]
        weight = weights[f, v]
        if not weight > 0.0:
            continue
        scale = math.sqrt(weight) / sigma[f, v]
        own = scaled[now]
        for a in range(2):
            own[a, 3] = scale * residuals[f, v, a]
            for i in range(3):
                own[a, i] = scale * jacobians[f, v, a, i]
        c = 0.0
        if last >= 0 and f - last <= REACH and weight > _IN_TOUCH:
            c = shared * math.sqrt(weight * last_weight)
        fresh = 1.0 / (1.0 - c * c)
        before = scaled[1 - now]
        x = own[0, 3]
        y = own[1, 3]
        if c > 0.0:
            x -= c * before[0, 3]
            y -= c * before[1, 3]
            _add_outer(before, before, c * c * fresh, band[last, 0])
            _add_outer(own, before, -c * fresh, band[f, f - last])
            _add_pull(before, x, y, c * fresh, pull[last])
        _add_outer(own, own, fresh, band[f, 0])
        _add_pull(own, x, y, -fresh, pull[f])
        lasting = kept[f] if kept[f] < 1.0 else 0.0
        _add_outer(own, own, (1.0 - lasting) / (1.0 + lasting), seen[f])
        if weight > _IN_TOUCH:
            last = f
            last_weight = weight
            shared = 1.0
            now = 1 - now


@dense
def add_smoothness(differences, stiffness, path, band, pull):
    """Add that differences of neighbouring frames are small.

    Args:
        differences: shape (row, REACH + 1): what a row multiplies frames ``row`` to ``row + REACH`` with; the last may
            be 0 and the frame not there.
        stiffness: shape (row,): 1 over the variance of the row's result.
        path: shape (frame, 3).
        band: shape (frame, REACH + 1, 3, 3), added to.
        pull: shape (frame, 3), added to.
    """
    frames = path.shape[0]
    for row in range(differences.shape[0]):
        w = stiffness[row]
        if w == 0.0:
            continue
        reach = min(REACH, frames - 1 - row)
        c = differences[row]
        for i in range(3):
            jump = 0.0
            for a in range(reach + 1):
                jump += c[a] * path[row + a, i]
            for a in range(reach + 1):
                pull[row + a, i] -= w * c[a] * jump
        for a in range(reach + 1):
            for b in range(a + 1):
                value = w * c[a] * c[b]
                for i in range(3):
                    band[row + a, a - b, i, i] += value


@kernel
def assemble(residuals, jacobians, sigma, weights, kept, differences, stiffness, paths, ridge, band, pull, seen):
    """The terms of views and smoothness for all keypoints.

    Args:
        residuals: shape (keypoint, frame, view, 2).
        jacobians: shape (keypoint, frame, view, 2, 3).
        sigma: shape (keypoint, frame, view).
        weights: shape (keypoint, frame, view).
        kept: shape (frame,).
        differences: shape (row, REACH + 1).
        stiffness: shape (keypoint, row).
        paths: shape (keypoint, frame, 3).
        ridge: shape (keypoint,): information that ties each point, ever so weakly, to where it is.
        band: shape (keypoint, frame, REACH + 1, 3, 3), written.
        pull: shape (keypoint, frame, 3), written.
        seen: shape (keypoint, frame, 3, 3), written.
    """
    scaled = np.empty((2, 2, 4))
    for k in range(paths.shape[0]):
        band[k] = 0.0
        pull[k] = 0.0
        seen[k] = 0.0
        for f in range(paths.shape[1]):
            for i in range(3):
                band[k, f, 0, i, i] = ridge[k]
        for v in range(residuals.shape[2]):
            add_view(
                residuals[k], jacobians[k], sigma[k], weights[k], kept, v, band[k], pull[k], seen[k], scaled
            )  # fmt: skip
        add_smoothness(differences, stiffness[k], paths[k], band[k], pull[k])


@kernel
def direct_bones(bones, lengths, paths, directions, excess):
    """Directions of bones, from their second end to the first, and how much too long they are.

    Args:
        bones: shape (bone, 2), int64: keypoints.
        lengths: shape (bone,).
        paths: shape (keypoint, frame, 3).
        directions: shape (bone, frame, 3), written.
        excess: shape (bone, frame), written.
    """
    for b in range(bones.shape[0]):
        one = paths[bones[b, 0]]
        other = paths[bones[b, 1]]
        for f in range(paths.shape[1]):
            x = one[f, 0] - other[f, 0]
            y = one[f, 1] - other[f, 1]
            z = one[f, 2] - other[f, 2]
            length = math.sqrt(x * x + y * y + z * z)
            scale = 1.0 / length if length > 0.0 else 0.0
            directions[b, f, 0] = scale * x
            directions[b, f, 1] = scale * y
            directions[b, f, 2] = scale * z
            excess[b, f] = length - lengths[b]


@dense
def _message(seen, direction, tightness, room, out):
    """Add to ``out`` what a bone makes of its far end's information: along the bone, less the bone's own give."""
    trace = seen[0, 0] + seen[1, 1] + seen[2, 2]
    if not (trace > 0.0 and tightness > 0.0):
        return
    for i in range(3):
        for j in range(3):
            room[0, i, j] = seen[i, j]
        room[0, i, i] += _LOOSE * trace
    invert_3(room[0], room[1])
    variance = 1.0 / tightness
    for i in range(3):
        for j in range(3):
            variance += direction[i] * room[1, i, j] * direction[j]
    for i in range(3):
        for j in range(3):
            out[i, j] += direction[i] * direction[j] / variance


@kernel
def pass_messages(bones, order, directions, tightness, seen, told, inward):
    """What bones add to each keypoint's information, frame by frame, from everything beyond them.

    Two sweeps over a forest of bones, exact for a frame by itself (J. Pearl, "Reverend Bayes on inference engines",
    1982): towards the root, each bone tells what its subtree saw; then outwards, what all the rest did.

    Args:
        bones: shape (bone, 2), int64: keypoints.
        order: shape (tree bone, 2), int64: bones of the forest, those nearest to a root first, and which of their ends,
            0 or 1, is the outer one.
        directions: shape (bone, frame, 3).
        tightness: shape (bone, frame): 1 over the variance of the bone's length in a frame; 0 where it is not there.
        seen: shape (keypoint, frame, 3, 3): information of each frame.
        told: shape (keypoint, frame, 3, 3), written: what bones add.
        inward: shape (tree bone, 3, 3): room.
    """
    room = np.empty((2, 3, 3))
    total = np.empty((3, 3))
    told[:] = 0.0
    for f in range(seen.shape[1]):
        for n in range(order.shape[0] - 1, -1, -1):
            b = order[n, 0]
            outer = bones[b, order[n, 1]]
            inner = bones[b, 1 - order[n, 1]]
            for i in range(3):
                for j in range(3):
                    total[i, j] = seen[outer, f, i, j] + told[outer, f, i, j]
                    inward[n, i, j] = 0.0
            _message(total, directions[b, f], tightness[b, f], room, inward[n])
            for i in range(3):
                for j in range(3):
                    told[inner, f, i, j] += inward[n, i, j]
        for n in range(order.shape[0]):
            b = order[n, 0]
            outer = bones[b, order[n, 1]]
            inner = bones[b, 1 - order[n, 1]]
            for i in range(3):
                for j in range(3):
                    total[i, j] = seen[inner, f, i, j] + told[inner, f, i, j] - inward[n, i, j]
            _message(total, directions[b, f], tightness[b, f], room, told[outer, f])


@kernel
def add_to_diagonal(information, band):
    """Add information of single frames, shape (keypoint, frame, 3, 3), to the bands."""
    for k in range(band.shape[0]):
        for f in range(band.shape[1]):
            for i in range(3):
                for j in range(3):
                    band[k, f, 0, i, j] += information[k, f, i, j]


@dense
def _times_bones(bones, directions, tightness, vectors, out):
    """Add what bones do to vectors: each end is pulled along the bone by how far the two ends go apart."""
    for b in range(bones.shape[0]):
        one = bones[b, 0]
        other = bones[b, 1]
        for f in range(vectors.shape[1]):
            w = tightness[b, f]
            if w == 0.0:
                continue
            apart = 0.0
            for i in range(3):
                apart += directions[b, f, i] * (vectors[one, f, i] - vectors[other, f, i])
            for i in range(3):
                step = w * apart * directions[b, f, i]
                out[one, f, i] += step
                out[other, f, i] -= step


@dense
def _times_views(band, told, vector, out):
    """What views and smoothness do to one path's vector: its band without what stands there in place of bones."""
    times_path(band, vector, out)
    for f in range(vector.shape[0]):
        for i in range(3):
            for j in range(3):
                out[f, i] -= told[f, i, j] * vector[f, j]


@dense
def _combine(one, first, other, second):
    """``second = one first + other second``."""
    for k in range(first.shape[0]):
        for f in range(first.shape[1]):
            for i in range(3):
                second[k, f, i] = one * first[k, f, i] + other * second[k, f, i]


@dense
def _copy(first, second):
    """``second = first``; slices do the same, and take seconds to compile."""
    for k in range(first.shape[0]):
        for f in range(first.shape[1]):
            for i in range(3):
                second[k, f, i] = first[k, f, i]


@dense
def _fill(value, out):
    for k in range(out.shape[0]):
        for f in range(out.shape[1]):
            for i in range(3):
                out[k, f, i] = value


@dense
def _inner(first, second):
    total = 0.0
    for k in range(first.shape[0]):
        for f in range(first.shape[1]):
            for i in range(3):
                total += first[k, f, i] * second[k, f, i]
    return total


@kernel
def solve_jointly(band, told, lower, inverse, bones, directions, tightness, pull, most, tolerance, steps):
    """Solve for all paths and their bones together, by preconditioned conjugate gradients.

    The preconditioner solves every path by itself, with what bones tell it of its neighbours (Hestenes & Stiefel 1952).

    Args:
        band: shape (keypoint, frame, REACH + 1, 3, 3): of views and smoothness, and ``told`` on the diagonal.
        told: shape (keypoint, frame, 3, 3): what stands in place of bones in ``band``.
        lower: factor of ``band``.
        inverse: factor of ``band``.
        bones: shape (bone, 2).
        directions: shape (bone, frame, 3).
        tightness: shape (bone, frame).
        pull: shape (keypoint, frame, 3), in: what is to be solved for; out: what is left.
        most: iterations.
        tolerance: of the preconditioned residual, next to that at the start.
        steps: shape (keypoint, frame, 3), written.

    Returns:
        How many iterations it took.
    """
    keypoints = pull.shape[0]
    z = np.empty(pull.shape)
    along = np.empty(pull.shape)
    image = np.empty(pull.shape)
    _fill(0.0, along)
    _fill(0.0, steps)
    size = first = 0.0
    for n in range(most + 1):
        _copy(pull, z)
        for k in range(keypoints):
            solve_path(lower[k], inverse[k], z[k])
        before, size = size, _inner(pull, z)
        first = size if n == 0 else first
        if n == most or not size > tolerance * tolerance * first:
            return n
        turn = size / before if n > 0 else 0.0
        _combine(1.0, z, turn, along)
        for k in range(keypoints):
            _times_views(band[k], told[k], along[k], image[k])
        _times_bones(bones, directions, tightness, along, image)
        far = size / _inner(along, image)
        _combine(far, along, 1.0, steps)
        _combine(-far, image, 1.0, pull)
    return most


@kernel
def pull_bones(bones, directions, tightness, excess, pull):
    """Add what lengths that are not right pull at the ends of their bones; shape (keypoint, frame, 3)."""
    for b in range(bones.shape[0]):
        for f in range(pull.shape[1]):
            for i in range(3):
                step = tightness[b, f] * excess[b, f] * directions[b, f, i]
                pull[bones[b, 0], f, i] -= step
                pull[bones[b, 1], f, i] += step


@kernel
def square_differences(differences, stiffness, paths, covariance, squares, known):
    """How large differences of frames are, and how far the data say so.

    Args:
        differences: shape (row, REACH + 1).
        stiffness: shape (keypoint, row): 1 over the variance expected of a row.
        paths: shape (keypoint, frame, 3).
        covariance: shape (keypoint, frame, REACH + 1, 3, 3), within the band.
        squares: shape (keypoint, row), written: the squared result over what is expected of it.
        known: shape (keypoint, row), written: how many of the 3 numbers the data determine.
    """
    frames = paths.shape[1]
    for k in range(paths.shape[0]):
        for row in range(differences.shape[0]):
            w = stiffness[k, row]
            reach = min(REACH, frames - 1 - row)
            squared = 0.0
            for i in range(3):
                jump = 0.0
                for a in range(reach + 1):
                    jump += differences[row, a] * paths[k, row + a, i]
                squared += jump * jump
            spread = 0.0
            for a in range(reach + 1):
                for b in range(a + 1):
                    z = covariance[k, row + a, a - b]
                    trace = z[0, 0] + z[1, 1] + z[2, 2]
                    spread += (1.0 if a == b else 2.0) * differences[row, a] * differences[row, b] * trace
            squares[k, row] = w * squared
            known[k, row] = min(max(3.0 - w * spread, 0.0), 3.0) if w > 0.0 else 0.0
