"""Linking of the detections of one view over time into short tracks that end where the identity is ambiguous."""

from typing import NamedTuple

import numpy as np

from posefuse.kernels.jit import kernel, subroutine

MOST_ACTIVE = 32
"""Most tracks that are continued at the same time."""
_FAR = 1e9
_BOUND = 0.5
_VELOCITY_GAIN = 0.5


class ViewRows(NamedTuple):
    """Detections of one view.

    Attributes:
        pixels: shape (row, keypoint, 2), NaN where not detected.
        ids: shape (row,): the detector's identities, -1 without one.
        mirror: shape (keypoint,): keypoint of the opposite side.
        limits: longest gap in s, gate in extents at once, its growth per s, largest gate, least ratio of the distances
            of the second and the first candidate, their least difference as a share of the gate, least number of common
            keypoints, distance in extents within which a new detection ends a track.
    """

    pixels: np.ndarray
    ids: np.ndarray
    mirror: np.ndarray
    limits: np.ndarray


class _Active(NamedTuple):
    """Tracks that are continued: last row or -1, its time, the time since, and the velocity in px per s."""

    last: np.ndarray
    seen_s: np.ndarray
    dt: np.ndarray
    velocity: np.ndarray
    shift: np.ndarray


@subroutine
def _distance(pixels, a, b, shift, mirror, least_common):
    """Return the bounded mean distance of two detections in px, in the labeling of sides that agrees better.

    A distance of single keypoints is bounded by half the larger extent, so that one outlier does not end a track.
    """
    extent = max(_extent(pixels, a), _extent(pixels, b))
    bound = _BOUND * extent
    best = _FAR
    for swapped in range(2):
        total = 0.0
        common = 0
        for k in range(pixels.shape[1]):
            distance = _keypoint_distance(pixels, a, mirror[k] if swapped else k, b, k, shift)
            if np.isfinite(distance):
                total += min(distance, bound)
                common += 1
        if common >= least_common and extent > 0.0:
            best = min(best, total / common / extent)
    return best


@subroutine
def _keypoint_distance(pixels, a, first, b, second, shift):
    """Return the distance of a keypoint of a detection, moved by a shift, from one of another in px; NaN if missing."""
    dx = pixels[a, first, 0] + shift[0] - pixels[b, second, 0]
    dy = pixels[a, first, 1] + shift[1] - pixels[b, second, 1]
    return np.sqrt(dx * dx + dy * dy)


@subroutine
def _extent(pixels, row):
    """Return the diagonal of the box around a detection in px."""
    left = _FAR
    right = -_FAR
    top = _FAR
    bottom = -_FAR
    for k in range(pixels.shape[1]):
        if np.isfinite(pixels[row, k, 0]) and np.isfinite(pixels[row, k, 1]):
            left = min(left, pixels[row, k, 0])
            right = max(right, pixels[row, k, 0])
            top = min(top, pixels[row, k, 1])
            bottom = max(bottom, pixels[row, k, 1])
    if right < left:
        return 0.0
    return np.sqrt((right - left) ** 2 + (bottom - top) ** 2)


@subroutine
def _mostly_within(pixels, a, b, shift, mirror, limits):
    """Return whether half the common keypoints of two detections are within a share of the larger extent.

    Args:
        pixels, a, b, shift, mirror: as of :func:`_distance`.
        limits: share of the extent, and least number of common keypoints.
    """
    most = limits[0] * max(_extent(pixels, a), _extent(pixels, b))
    for swapped in range(2):
        common = 0
        within = 0
        for k in range(pixels.shape[1]):
            distance = _keypoint_distance(pixels, a, mirror[k] if swapped else k, b, k, shift)
            if np.isfinite(distance):
                common += 1
                within += distance <= most
        if common >= limits[1] and 2 * within >= common:
            return True
    return False


@subroutine
def _count(pixels, row):
    """Return the number of detected keypoints."""
    found = 0
    for k in range(pixels.shape[1]):
        if np.isfinite(pixels[row, k, 0]):
            found += 1
    return found


@kernel
def remove_duplicates(starts, pixels, mirror, least_common, nearest, track):
    """Mark detections that repeat a more complete one of the same frame.

    Args:
        starts: shape (frame + 1,): first row of each frame.
        pixels: shape (row, keypoint, 2), NaN where not detected.
        mirror: shape (keypoint,): keypoint of the opposite side.
        least_common: least number of common keypoints.
        nearest: greatest distance of duplicates, as a share of their extent.
        track: shape (row,): -1; becomes -2 for duplicates.
    """
    still = np.zeros(2)
    for f in range(len(starts) - 1):
        for a in range(starts[f], starts[f + 1]):
            for b in range(a + 1, starts[f + 1]):
                if track[a] == -2 or track[b] == -2:
                    continue
                if _distance(pixels, a, b, still, mirror, least_common) < nearest:
                    track[b if _count(pixels, b) <= _count(pixels, a) else a] = -2


@subroutine
def _lowest(costs, n):
    """Return the index of the lowest of the first n costs, or -1."""
    best = -1
    low = _FAR
    for i in range(n):
        if costs[i] < low:
            low = costs[i]
            best = i
    return best


@subroutine
def _fill_costs(view, rows, active, cost):
    """Write the distance of every track's prediction from every detection, in extents."""
    last = active.last
    for i in range(len(last)):
        for j in range(len(rows)):
            cost[i, j] = _FAR
            if last[i] >= 0 and rows[j] >= 0:
                active.shift[0] = active.velocity[i, 0] * active.dt[i]
                active.shift[1] = active.velocity[i, 1] * active.dt[i]
                cost[i, j] = _distance(view.pixels, last[i], rows[j], active.shift, view.mirror, view.limits[6])


@subroutine
def _gate(dt, limits):
    """Return the largest distance of a link in extents after a time."""
    return min(limits[1] + limits[2] * dt, limits[3])


@subroutine
def _is_link(cost, i, j, n, dt, limits):
    """Return whether a track and a detection are each other's nearest, without a second candidate of either.

    A track that was not seen for a while is a candidate of more detections, as its prediction is uncertain.
    """
    c = cost[i, j]
    clear = max(limits[4] * c, c + limits[5] * _gate(dt[i], limits))
    for k in range(n):
        if k != j and cost[i, k] < clear:
            return False
    for other in range(len(cost)):
        if other != i and cost[other, j] < max(limits[4] * c, c + limits[5] * _gate(dt[other], limits)):
            return False
    return True


@subroutine
def _mean_shift(pixels, a, b, axis):
    """Return the mean motion of the common keypoints along one axis in px."""
    total = 0.0
    common = 0
    for k in range(pixels.shape[1]):
        d = pixels[b, k, axis] - pixels[a, k, axis]
        if np.isfinite(d):
            total += d
            common += 1
    return total / max(common, 1)


@kernel
def link_detections(starts, time_s, view, track):
    """Assign detections to tracks of one view.

    A track ends when it is not seen for a while, when it or its nearest detection has a second candidate, and when
    another detection appears so close to it that it may be the one that was hidden or merged with it before. It also
    ends where the detector's identity changes to that of another active track; the same identity doubles the gate.
    A detection beyond the gate, of which half the keypoints are within it, continues a track if there is no second
    candidate: a detector that mistakes the limbs of a person for a few frames still sees the same person.

    Args:
        starts: shape (frame + 1,): first row of each frame.
        time_s: shape (frame,): time of each frame, ascending.
        view: detections and limits.
        track: shape (row,): -1, or -2 for detections to skip; index of the track is written.

    Returns:
        Number of tracks.
    """
    n_tracks = 0
    active = _Active(
        np.full(MOST_ACTIVE, -1),
        np.zeros(MOST_ACTIVE),
        np.zeros(MOST_ACTIVE),
        np.zeros((MOST_ACTIVE, 2)),
        np.zeros(2),
    )
    most = 1
    for f in range(len(time_s)):
        most = max(most, starts[f + 1] - starts[f])
    cost = np.zeros((MOST_ACTIVE, most))
    rows = np.full(most, -1)
    for f in range(len(time_s)):
        n = starts[f + 1] - starts[f]
        for j in range(most):
            rows[j] = starts[f] + j if j < n and track[starts[f] + j] == -1 else -1
        for i in range(MOST_ACTIVE):
            active.dt[i] = time_s[f] - active.seen_s[i]
            if active.dt[i] > view.limits[0]:
                active.last[i] = -1
        _fill_costs(view, rows, active, cost)
        for i in range(MOST_ACTIVE):
            if active.last[i] >= 0:
                _continue_track(i, rows, view, active, cost, track)
        _end_near_new(starts[f], n, view, active, track)
        for j in range(n):
            if rows[j] >= 0 and track[rows[j]] == -1:
                slot = _free_slot(active)
                track[rows[j]] = n_tracks
                n_tracks += 1
                active.last[slot] = rows[j]
                active.seen_s[slot] = time_s[f]
                active.velocity[slot, 0] = 0.0
                active.velocity[slot, 1] = 0.0
    return n_tracks


@subroutine
def _end_near_new(start, n, view, active, track):
    """End the tracks that have a new detection near their own, which then starts another track."""
    active.shift[:] = 0.0
    for i in range(len(active.last)):
        a = active.last[i]
        if a < start:
            continue
        for j in range(start, start + n):
            near = view.limits[7]
            if track[j] == -1 and _distance(view.pixels, a, j, active.shift, view.mirror, view.limits[6]) < near:
                track[a] = -1
                active.last[i] = -1
                break


@subroutine
def _free_slot(active):
    """Return an unused slot, or the one that was not seen for the longest time."""
    oldest = 0
    for i in range(len(active.last)):
        if active.last[i] < 0:
            return i
        if active.seen_s[i] < active.seen_s[oldest]:
            oldest = i
    return oldest


@subroutine
def _continue_track(i, rows, view, active, cost, track):
    """Link one track to a detection, end it if that is ambiguous, or leave it as it is without a detection."""
    n = len(rows)
    j = _lowest(cost[i], n)
    if j < 0:
        return
    a = active.last[i]
    b = rows[j]
    gate = _gate(active.dt[i], view.limits)
    known = view.ids[a] >= 0 and view.ids[b] >= 0
    if known and view.ids[a] == view.ids[b]:
        gate *= 2.0
    clear = _is_link(cost, i, j, n, active.dt, view.limits)
    near = cost[i, j] <= gate
    if not near:
        active.shift[0] = active.velocity[i, 0] * active.dt[i]
        active.shift[1] = active.velocity[i, 1] * active.dt[i]
        if not (clear and _mostly_within(view.pixels, a, b, active.shift, view.mirror, (gate, view.limits[6]))):
            return
    if not clear or (known and _is_other(i, view.ids, a, b, active.last)):
        active.last[i] = -1
        return
    track[b] = track[a]
    if near and active.dt[i] > 0.0:
        for axis in range(2):
            measured = _mean_shift(view.pixels, a, b, axis) / active.dt[i]
            active.velocity[i, axis] += _VELOCITY_GAIN * (measured - active.velocity[i, axis])
    active.last[i] = b
    active.seen_s[i] += active.dt[i]


@subroutine
def _is_other(i, ids, a, b, last):
    """Return whether a detection has the identity of another active track."""
    others = 0
    for other in range(len(last)):
        others += other != i and last[other] >= 0 and ids[last[other]] == ids[b]
    return ids[a] != ids[b] and others > 0
