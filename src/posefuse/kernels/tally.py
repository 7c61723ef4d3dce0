"""Counts of a frame: what became of keypoints, who should be seen where, and how well views fit."""

import math

from posefuse.kernels.articulated import GATED, USED
from posefuse.kernels.jit import kernel, step


@kernel
def count_uses(use, of_view, used, gated):
    """Count what became of keypoints.

    Args:
        use: shape (person, view, keypoint), int64: USED, GATED or UNSEEN.
        of_view: shape (person, view), int64, written: how many keypoints of a view counted.
        used: shape (person, keypoint), int64, written: in how many views a keypoint counted.
        gated: shape (person, keypoint), int64, written: in how many it was too far off.
    """
    for p in range(use.shape[0]):
        for k in range(use.shape[2]):
            used[p, k] = 0
            gated[p, k] = 0
        for v in range(use.shape[1]):
            of_view[p, v] = 0
            for k in range(use.shape[2]):
                if use[p, v, k] == USED:
                    of_view[p, v] += 1
                    used[p, k] += 1
                elif use[p, v, k] == GATED:
                    gated[p, k] += 1


@kernel
def foretell_views(points, pixels, sizes_px, chosen, share, expected, middles):
    """Which views should see whom, and where that is.

    Args:
        points: shape (person, keypoint, 3), NaN where there is none.
        pixels: shape (person, view, keypoint, 2), NaN where a view cannot see it.
        sizes_px: shape (view, 2): of the images.
        chosen: shape (core,), int64: the keypoints that tell.
        share: which of those must be within the image.
        expected: shape (person, view), bool, written.
        middles: shape (person, 3), written: means of those that there are; 0 where there are none.
    """
    for p in range(points.shape[0]):
        _middle(points, p, chosen, middles)
        for v in range(sizes_px.shape[0]):
            inside = 0
            for i in range(chosen.shape[0]):
                x, y = pixels[p, v, chosen[i], 0], pixels[p, v, chosen[i], 1]
                inside += 1 if 0.0 <= x < sizes_px[v, 0] and 0.0 <= y < sizes_px[v, 1] else 0
            expected[p, v] = inside >= share * chosen.shape[0]


@step
def _middle(points, p, chosen, middles):
    """The mean of the chosen points of a person."""
    for a in range(3):
        total = 0.0
        there = 0
        for i in range(chosen.shape[0]):
            value = points[p, chosen[i], a]
            if math.isfinite(value):
                total += value
                there += 1
        middles[p, a] = total / max(there, 1)


@kernel
def weigh_views(supported, expected, free, fade, dt_s, expected_s, matched_s, shown_s):
    """For how long, lately, views were to show people whom two others agree on, did so, and showed nobody's detections.

    Args:
        supported: shape (person, view), bool: which views show whom.
        expected: shape (person, view), bool: which should.
        free: shape (view,), int64: how many detections are nobody's.
        fade: what is left of former times.
        dt_s: since the last frame.
        expected_s, matched_s, shown_s: shape (view,), in and out.
    """
    for v in range(supported.shape[1]):
        sure = 0
        matched = 0
        for p in range(supported.shape[0]):
            others = 0
            for u in range(supported.shape[1]):
                others += 1 if supported[p, u] and u != v else 0
            if expected[p, v] and others >= 2:
                sure += 1
                matched += 1 if supported[p, v] else 0
        expected_s[v] = expected_s[v] * fade + dt_s * sure
        matched_s[v] = matched_s[v] * fade + dt_s * matched
        shown_s[v] = shown_s[v] * fade + dt_s * min(free[v], sure - matched)
