"""Linking of the detections of one view, written plainly: lists and dictionaries instead of slots."""

from dataclasses import dataclass

import numpy as np


@dataclass
class _Track:
    number: int
    row: int
    seen_s: float
    velocity: np.ndarray


def extent(points: np.ndarray) -> float:
    """Return the diagonal of the box around keypoints."""
    return float(np.hypot(*(np.nanmax(points, axis=0) - np.nanmin(points, axis=0))))


def distance(a: np.ndarray, b: np.ndarray, mirror: np.ndarray, least_common: int) -> float:
    """Return the bounded mean distance of two detections in extents, with the sides that agree better."""
    size = max(extent(a), extent(b))
    values = []
    for each in (a, a[mirror]):
        lengths = np.linalg.norm(each - b, axis=1)
        lengths = lengths[np.isfinite(lengths)]
        if len(lengths) >= least_common:
            values.append(np.minimum(lengths, 0.5 * size).mean() / size)
    return min(values, default=1e9)


def mostly_within(a: np.ndarray, b: np.ndarray, mirror: np.ndarray, least_common: int, most: float) -> bool:
    """Return whether the median distance of two detections is small, with the sides that agree better."""
    size = max(extent(a), extent(b))
    for each in (a, a[mirror]):
        lengths = np.linalg.norm(each - b, axis=1)
        lengths = np.sort(lengths[np.isfinite(lengths)])
        if len(lengths) >= least_common and lengths[(len(lengths) - 1) // 2] <= most * size:
            return True
    return False


def link(starts, time_s, pixels, mirror, limits) -> np.ndarray:
    """Return the track of each row; arguments as of the kernel, without identities and repeated detections."""
    gap, gate_0, gate_per_s, gate_most, ratio, margin, least_common, near = limits
    track = np.full(len(pixels), -1)
    active: list[_Track] = []
    count = 0
    for f, now in enumerate(time_s):
        rows = list(range(starts[f], starts[f + 1]))
        active = [t for t in active if now - t.seen_s <= gap]
        gates = {t.number: min(gate_0 + gate_per_s * (now - t.seen_s), gate_most) for t in active}
        cost = {
            (t.number, r): distance(pixels[t.row] + t.velocity * (now - t.seen_s), pixels[r], mirror, least_common)
            for t in active
            for r in rows
        }
        ended = set()
        for t in active:
            best = min(rows, key=lambda r: cost[t.number, r], default=None)
            if best is None:
                continue
            c = cost[t.number, best]
            close = c <= gates[t.number]
            predicted = pixels[t.row] + t.velocity * (now - t.seen_s)
            if not close and not mostly_within(predicted, pixels[best], mirror, least_common, gates[t.number]):
                continue
            rivals = [o for o in active if o is not t]
            clear = all(cost[t.number, r] >= max(ratio * c, c + margin * gates[t.number]) for r in rows if r != best)
            clear &= all(cost[o.number, best] >= max(ratio * c, c + margin * gates[o.number]) for o in rivals)
            if not clear:
                if close:
                    ended.add(t.number)
                continue
            track[best] = t.number
            if close:
                motion = np.nanmean(pixels[best] - pixels[t.row], axis=0) / (now - t.seen_s)
                t.velocity = t.velocity + 0.5 * (motion - t.velocity)
            t.row, t.seen_s = best, now
        new = [r for r in rows if track[r] == -1]
        for t in active:
            linked = t.row in rows
            if linked and any(distance(pixels[t.row], pixels[r], mirror, least_common) < near for r in new):
                track[t.row] = -1
                ended.add(t.number)
                new = [r for r in rows if track[r] == -1]
        active = [t for t in active if t.number not in ended]
        for r in new:
            track[r] = count
            active.append(_Track(count, r, now, np.zeros(2)))
            count += 1
    return track
