"""Per-frame statistics of tracks: use of keypoints, expected visibility, camera activity and label swaps."""

import math

from posefuse.kernels.jit import kernel
from posefuse.kernels.tracking.records import GATED, USED


@kernel
def count_observations(use, used_in_view, used, gated):
    """Count used and gated observations.

    Args:
        use: shape (person, view, keypoint), int64: USED, GATED or UNOBSERVED.
        used_in_view: shape (person, view), int64, written: number of used keypoints per view.
        used: shape (person, keypoint), int64, written: number of views in which a keypoint was used.
        gated: shape (person, keypoint), int64, written: number of views in which a keypoint failed the gate.
    """
    for p in range(use.shape[0]):
        for k in range(use.shape[2]):
            used[p, k] = 0
            gated[p, k] = 0
        for v in range(use.shape[1]):
            used_in_view[p, v] = 0
            for k in range(use.shape[2]):
                if use[p, v, k] == USED:
                    used_in_view[p, v] += 1
                    used[p, k] += 1
                elif use[p, v, k] == GATED:
                    gated[p, k] += 1


@kernel
def predict_visibility(pixels, sizes_px, core, min_fraction, expected):
    """Predict which views should see each person.

    Args:
        pixels: shape (person, view, keypoint, 2), NaN where a view cannot see the point.
        sizes_px: shape (view, 2): image sizes.
        core: shape (core,), int64: the keypoints to consider.
        min_fraction: fraction of these that must lie inside the image.
        expected: shape (person, view), bool, written.
    """
    for p in range(pixels.shape[0]):
        for v in range(sizes_px.shape[0]):
            n_inside = 0
            for i in range(core.shape[0]):
                x, y = pixels[p, v, core[i], 0], pixels[p, v, core[i], 1]
                n_inside += 1 if 0.0 <= x < sizes_px[v, 0] and 0.0 <= y < sizes_px[v, 1] else 0
            expected[p, v] = n_inside >= min_fraction * core.shape[0]


@kernel
def accumulate_view_support(supported, expected, unassigned, decay, dt_s, support):
    """Accumulate for how long each view should have shown people that two other views support, and for how long it did.

    Args:
        supported: shape (person, view), bool: which views support each person.
        expected: shape (person, view), bool: which views should.
        unassigned: shape (view,), int64: number of unassigned detections.
        decay: factor by which former times are multiplied.
        dt_s: time since the last frame.
        support: ViewSupport, in and out.
    """
    expected_s, matched_s, unassigned_s, due = support
    for v in range(supported.shape[1]):
        n_due = 0
        matched = 0
        for p in range(supported.shape[0]):
            others = 0
            for u in range(supported.shape[1]):
                others += 1 if supported[p, u] and u != v else 0
            if expected[p, v] and others >= 2:
                n_due += 1
                matched += 1 if supported[p, v] else 0
        due[v] = n_due
        expected_s[v] = expected_s[v] * decay + dt_s * n_due
        matched_s[v] = matched_s[v] * decay + dt_s * matched
        unassigned_s[v] = unassigned_s[v] * decay + dt_s * min(unassigned[v], n_due - matched)


@kernel
def update_silence(recorded, n_detections, due, dt_s, silence_after_s, active_after_s, silence, change):
    """Update for how long each view has had no data, and detect views that become silent or active again.

    Args:
        recorded: shape (view,), bool: whether the view recorded this frame.
        n_detections: shape (view,), int64.
        due: shape (view,), int64: number of people the view should show.
        dt_s: time since the last frame.
        silence_after_s: a view without data for this long becomes silent.
        active_after_s: a silent view with data for this long becomes active.
        silence: ViewSilence, in and out.
        change: shape (view,), int64, written: 1 where a view becomes silent, -1 where it becomes active again, else 0.

    Returns:
        Number of changes.
    """
    absent_s, undetected_s, active_s, silent = silence
    changes = 0
    for v in range(silent.shape[0]):
        absent_s[v] = 0.0 if recorded[v] else absent_s[v] + dt_s
        if n_detections[v] > 0:
            undetected_s[v] = 0.0
        elif recorded[v] and due[v] > 0:
            undetected_s[v] += dt_s
        # A view without frames becomes active by a frame; a view without detections becomes active by a detection.
        quiet_s = max(absent_s[v], undetected_s[v])
        if quiet_s == 0.0:
            active_s[v] += dt_s
        if not silent[v] or quiet_s > active_after_s:
            active_s[v] = 0.0
        change[v] = 0
        if silent[v] and active_s[v] >= active_after_s:
            change[v] = -1
        elif not silent[v] and quiet_s >= silence_after_s:
            change[v] = 1
        if change[v] != 0:
            silent[v] = change[v] > 0
            changes += 1
    return changes


@kernel
def record_matches(rows, swapped, swap_odds, track_ids, dt_s, single_view_s, swap_probability, ids):
    """Record the properties of the detections assigned to tracks.

    Args:
        rows: shape (track, view), int64: the assigned detections, -1 for none.
        swapped: shape (track, row, group), int8: whether left and right of a limb would be swapped.
        swap_odds: shape (track, row, group): log odds of the swap; if the labels are correct, of a turned body.
        track_ids: shape (row,), int64: identities given by the detector.
        dt_s: time since the last frame.
        single_view_s: shape (track,), in and out: for how long a single view alone has detected the track.
        swap_probability: shape (track, view, group), in and out: probability that a limb is swapped.
        ids: shape (track, view), int64, in and out: detector identity of the last match.
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
                swap_probability[p, v, g] = 1.0 / (1.0 + math.exp(-odds))
        single_view_s[p] = single_view_s[p] + dt_s if views == 1 else 0.0


@kernel
def update_gated_time(used, gated, dt_s, gated_s):
    """Update for how long most views, and at least two, have gated each keypoint; return the longest time.

    Args:
        used: shape (track, keypoint), int64: number of views in which the keypoint was used.
        gated: shape (track, keypoint), int64: number of views in which it failed the gate.
        dt_s: time since the last frame.
        gated_s: shape (track, keypoint), in and out.
    """
    longest = 0.0
    for p in range(gated_s.shape[0]):
        for k in range(gated_s.shape[1]):
            gated_s[p, k] = gated_s[p, k] + dt_s if gated[p, k] >= 2 and gated[p, k] > used[p, k] else 0.0
            longest = max(longest, gated_s[p, k])
    return longest


@kernel
def clear_majority_swaps(rows, swapped):
    """Clear swaps that most views report: then the predicted body is turned, and the labels are correct.

    Args:
        rows: shape (track, view), int64: the assigned detections, -1 for none.
        swapped: shape (track, row, group), int8, in and out: whether left and right are swapped.
    """
    for p in range(rows.shape[0]):
        for g in range(swapped.shape[2]):
            views = 0
            n_swapped = 0
            for v in range(rows.shape[1]):
                if rows[p, v] >= 0:
                    views += 1
                    n_swapped += 1 if swapped[p, rows[p, v], g] != 0 else 0
            if n_swapped > 0 and 2 * n_swapped >= views:
                for row in range(swapped.shape[1]):
                    swapped[p, row, g] = 0


@kernel
def assign_labels(rows, swapped, group_of, mirror, labels):
    """Assign to each body keypoint the keypoint of the detection that observes it.

    Args:
        rows: shape (track, view), int64: the assigned detections, -1 for none.
        swapped: shape (track, row, group), int8: whether left and right are swapped.
        group_of: shape (keypoint,), int64: group of each keypoint, -1 for none.
        mirror: shape (keypoint,), int64: the keypoint on the other side.
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
def add_identity_scores(ids, view, track_ids, bonus, min_score, scores, assigned):
    """Add a bonus to the scores of detections whose detector identity equals that of the last match.

    Args:
        ids: shape (track, view), int64: identity of the last match, -1 for none.
        view: shape (row,), int64: view of each detection.
        track_ids: shape (row,), int64: its identity, -1 for none.
        bonus: score of an equal identity.
        min_score: a detection with a higher score belongs to a track.
        scores: shape (track, row), in and out.
        assigned: shape (row,), bool, written: whether the detection belongs to any track.
    """
    for row in range(view.shape[0]):
        assigned[row] = False
        for p in range(ids.shape[0]):
            if track_ids[row] >= 0 and ids[p, view[row]] == track_ids[row]:
                scores[p, row] += bonus
            if scores[p, row] > min_score:
                assigned[row] = True
