"""Counts of a frame: what became of keypoints, who should be seen where, and how well views fit."""

import math

from posefuse.kernels.jit import kernel, step
from posefuse.kernels.tracking.articulated import GATED, USED


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
def weigh_views(supported, expected, free, fade, dt_s, expected_s, matched_s, shown_s, due):
    """For how long, lately, views were to show people whom two others agree on, did so, and showed nobody's detections.

    Args:
        supported: shape (person, view), bool: which views show whom.
        expected: shape (person, view), bool: which should.
        free: shape (view,), int64: how many detections are nobody's.
        fade: what is left of former times.
        dt_s: since the last frame.
        expected_s, matched_s, shown_s: shape (view,), in and out.
        due: shape (view,), int64, written: how many people of this frame were to be shown.
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
        due[v] = sure
        expected_s[v] = expected_s[v] * fade + dt_s * sure
        matched_s[v] = matched_s[v] * fade + dt_s * matched
        shown_s[v] = shown_s[v] * fade + dt_s * min(free[v], sure - matched)


@kernel
def note_silence(recorded, shown, due, dt_s, silent_s, back_s, absent_s, blind_s, heard_s, silent, change):
    """For how long views have said nothing; who falls silent, and who is heard again.

    Args:
        recorded: shape (view,), bool: whether the view has this frame.
        shown: shape (view,), int64: how many detections it has.
        due: shape (view,), int64: how many people it should show.
        dt_s: since the last frame.
        silent_s: who says nothing for so long is silent.
        back_s: who is heard for so long is silent no more.
        absent_s: shape (view,), in and out: since its last frame.
        blind_s: shape (view,), in and out: for how long it has shown nobody while it should have.
        heard_s: shape (view,), in and out: for how long it has been heard, while it is silent.
        silent: shape (view,), bool, in and out.
        change: shape (view,), int64, written: 1 where it falls silent, -1 where it is heard again, else 0.

    Returns:
        How many do either.
    """
    changes = 0
    for v in range(silent.shape[0]):
        absent_s[v] = 0.0 if recorded[v] else absent_s[v] + dt_s
        if shown[v] > 0:
            blind_s[v] = 0.0
        elif recorded[v] and due[v] > 0:
            blind_s[v] += dt_s
        # Who was silent without frames is heard by a frame, who showed nobody by a detection.
        quiet_s = max(absent_s[v], blind_s[v])
        if quiet_s == 0.0:
            heard_s[v] += dt_s
        if not silent[v] or quiet_s > back_s:
            heard_s[v] = 0.0
        change[v] = 0
        if silent[v] and heard_s[v] >= back_s:
            change[v] = -1
        elif not silent[v] and quiet_s >= silent_s:
            change[v] = 1
        if change[v] != 0:
            silent[v] = change[v] > 0
            changes += 1
    return changes


@kernel
def note_matches(rows, swapped, swap_odds, track_ids, dt_s, alone_s, was_swapped, ids):
    """Note what the detections of people are like.

    Args:
        rows: shape (track, view), int64: the detections that are theirs, -1 for none.
        swapped: shape (track, row, group), int8: whose sides would be exchanged.
        swap_odds: shape (track, row, group): the log odds of that, where labels are right: of the body's being turned.
        track_ids: shape (row,), int64: the detector's identities.
        dt_s: since the last frame.
        alone_s: shape (track,), in and out: for how long one view alone has shown them.
        was_swapped: shape (track, view, group), in and out: how probable it is that limbs are swapped.
        ids: shape (track, view), int64, in and out: of the last match.
    """
    for p in range(rows.shape[0]):
        views = 0
        for v in range(rows.shape[1]):
            row = rows[p, v]
            if row < 0:
                continue
            views += 1
            ids[p, v] = track_ids[row]
            for g in range(swapped.shape[2]):
                odds = swap_odds[p, row, g] if swapped[p, row, g] != 0 else -abs(swap_odds[p, row, g])
                was_swapped[p, v, g] = 1.0 / (1.0 + math.exp(-odds))
        alone_s[p] = alone_s[p] + dt_s if views == 1 else 0.0


@kernel
def note_off(used, gated, dt_s, off_s):
    """For how long most views, and more than one, have seen each keypoint elsewhere; the longest of all.

    Args:
        used: shape (track, keypoint), int64: in how many views it counted.
        gated: shape (track, keypoint), int64: in how many it was too far off.
        dt_s: since the last frame.
        off_s: shape (track, keypoint), in and out.
    """
    longest = 0.0
    for p in range(off_s.shape[0]):
        for k in range(off_s.shape[1]):
            off_s[p, k] = off_s[p, k] + dt_s if gated[p, k] >= 2 and gated[p, k] > used[p, k] else 0.0
            longest = max(longest, off_s[p, k])
    return longest


@kernel
def believe_most_labels(rows, swapped):
    """Where most views would have a limb's sides exchanged, it is the body that has: labels are right.

    Args:
        rows: shape (track, view), int64: the detections that are theirs, -1 for none.
        swapped: shape (track, row, group), int8, in and out: whose sides are exchanged.
    """
    for p in range(rows.shape[0]):
        for g in range(swapped.shape[2]):
            views = 0
            exchanged = 0
            for v in range(rows.shape[1]):
                if rows[p, v] >= 0:
                    views += 1
                    exchanged += 1 if swapped[p, rows[p, v], g] != 0 else 0
            if exchanged > 0 and 2 * exchanged >= views:
                for row in range(swapped.shape[1]):
                    swapped[p, row, g] = 0


@kernel
def label_keypoints(rows, swapped, group_of, mirror, labels):
    """Which of a detection's keypoints is the body's.

    Args:
        rows: shape (track, view), int64: the detections that are theirs, -1 for none.
        swapped: shape (track, row, group), int8: whose sides are exchanged.
        group_of: shape (keypoint,), int64: of which group each is, -1 of none.
        mirror: shape (keypoint,), int64: the other side's.
        labels: shape (track, view, keypoint), int64, written.
    """
    for p in range(rows.shape[0]):
        for v in range(rows.shape[1]):
            row = rows[p, v]
            for k in range(group_of.shape[0]):
                labels[p, v, k] = k
                if row >= 0 and group_of[k] >= 0 and swapped[p, row, group_of[k]] != 0:
                    labels[p, v, k] = mirror[k]


@kernel
def add_identities(ids, view, track_ids, worth, least, scores, explained):
    """What detections are worth by the detector's identities, too.

    Args:
        ids: shape (track, view), int64: of the last match, -1 for none.
        view: shape (row,), int64: of each detection.
        track_ids: shape (row,), int64: its identity, -1 for none.
        worth: of one that is the same.
        least: a detection of more is somebody's.
        scores: shape (track, row), in and out.
        explained: shape (row,), bool, written: whether it is somebody's.
    """
    for row in range(view.shape[0]):
        explained[row] = False
        for p in range(ids.shape[0]):
            if track_ids[row] >= 0 and ids[p, view[row]] == track_ids[row]:
                scores[p, row] += worth
            if scores[p, row] > least:
                explained[row] = True
