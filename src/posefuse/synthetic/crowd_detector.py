"""Simulate the detections of several people: keypoint errors, and faults that occur in crowds.

Keypoint errors are those of one person (:mod:`posefuse.synthetic.detector`), independent for every person and view. In
addition people occlude each other, merge into one detection where they overlap, are detected twice or not at all, and
false people appear; all faults last for intervals.
"""

from dataclasses import replace
from itertools import combinations

import numpy as np

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections, frame_times
from posefuse.skeleton.skeletons import Skeleton
from posefuse.synthetic.bodies import Capsules, bodies_of, hidden_keypoints
from posefuse.synthetic.crowd_options import CrowdFaults
from posefuse.synthetic.crowd_records import CrowdDetections, DetectionSlots, Kind, Staging
from posefuse.synthetic.detector import Hidden, add_errors, correlated_noise, on_intervals
from posefuse.synthetic.options import DetectorOptions

_MISS_DWELL_S, _MERGE_DWELL_S, _DUPLICATE_DWELL_S, _FALSE_DWELL_S = 0.3, 0.4, 0.2, 2.0
_FALSE_PER_VIEW = 2
_JITTER_PX_AT_1000 = 4.0
_FALSE_DRIFT_PX_S = 15.0


def detect_crowd(
    rig: CameraRig,
    points_m: np.ndarray,
    skeleton: Skeleton,
    rate_hz: float,
    law: DetectorOptions,
    faults: CrowdFaults,
    staging: Staging,
    rng: np.random.Generator,
) -> CrowdDetections:
    """Simulate the detections of several people.

    Args:
        rig: cameras.
        points_m: shape (frame, person, keypoint, 3): true positions; NaN while absent.
        skeleton: skeleton of the keypoints.
        rate_hz: frame rate.
        law: errors of keypoints.
        faults: faults with several people.
        staging: staged events.
        rng: random generator.
    """
    exact = _exact(rig, points_m, staging)
    sizes = np.array([camera.size_px for camera in rig.cameras])
    capsules = Capsules.concatenate([bodies_of(points_m, skeleton), staging.things])
    behind = hidden_keypoints(rig, points_m, capsules, 1.0 if skeleton.tree is None else skeleton.tree.scale)
    people = _single_detections(exact, behind, sizes, skeleton, rate_hz, law, faults, rng)
    overlaps = _overlaps(exact, people.there, faults)
    if faults.track_ids:
        people.ids[:] = _identities(people.there, overlaps, rate_hz, faults, rng)
    if faults.taken_share:
        # A generator of its own: the other faults are those of a scene without this one.
        _take_limbs(people, overlaps, behind, skeleton, rate_hz, faults, rng.spawn(1)[0])
    _merge(people, overlaps, staging, rate_hz, faults, rng)
    doubles = _duplicates(people, sizes, rate_hz, faults, rng)
    false_people = _false_people(exact, sizes, rate_hz, faults, rng)
    parts = [people, doubles, false_people]
    for part in parts:
        part.drop(staging.dark[..., None] & part.there)
    if faults.track_ids:
        _identify_false_detections(doubles, false_people, int(people.ids.max(initial=-1)))
    return _rows(parts, rig, skeleton, rate_hz, faults, rng)


def _exact(rig: CameraRig, points_m: np.ndarray, staging: Staging) -> np.ndarray:
    """Project into the cameras with their true poses, shape (frame, view, person, keypoint, 2)."""
    exact = rig.project(points_m)
    if staging.turned.any():
        turned = staging.turned_rig.project(points_m)
        exact = np.where(staging.turned[:, :, None, None, None], turned, exact)
    return np.ascontiguousarray(exact)


def _single_detections(
    exact: np.ndarray,
    behind: np.ndarray,
    sizes: np.ndarray,
    skeleton: Skeleton,
    rate_hz: float,
    law: DetectorOptions,
    faults: CrowdFaults,
    rng: np.random.Generator,
) -> DetectionSlots:
    """Return single detections of all people, with independent errors and occlusion."""
    n_frames, n_views, n_people, n_keypoints, _ = exact.shape
    columns = (n_frames, n_views * n_people, n_keypoints)
    if law.swap_shares:
        law = replace(law, swap_shares=tuple(np.repeat(law.swap_shares, n_people)))
    hidden = Hidden(behind.reshape(columns), faults.hidden_miss_share, faults.hidden_confidence, faults.hidden_error)
    column_sizes = np.repeat(sizes, n_people, axis=0)
    pixels, confidence = add_errors(exact.reshape(*columns, 2), column_sizes, skeleton, rate_hz, law, rng, hidden)
    shape = exact.shape[:4]
    seen = DetectionSlots.of(pixels.reshape(*shape, 2), confidence.reshape(shape), np.arange(n_people), Kind.PERSON)
    missed = on_intervals(shape[:3], faults.miss_share, _MISS_DWELL_S, rate_hz, rng)
    seen.drop(missed | ~_noticeable(exact, behind, sizes, faults))
    return seen


def _noticeable(exact: np.ndarray, behind: np.ndarray, sizes: np.ndarray, faults: CrowdFaults) -> np.ndarray:
    """Return shape (frame, view, person), bool: large enough in the image and sufficiently visible."""
    inside = ((exact > -0.5) & (exact < sizes[:, None, None] - 0.5)).all(axis=-1)
    visible = (inside & ~behind).mean(axis=-1)
    _, height = _middle_and_height(exact)
    return (visible >= faults.visible_share) & (height >= faults.smallest_px)


def _middle_and_height(exact: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean keypoint, (frame, view, person, 2), and the larger extent, (frame, view, person), in px.

    NaN and 0 where nothing is to be seen.
    """
    known = np.isfinite(exact)
    count = known.sum(axis=-2)
    middle = np.where(known, exact, 0.0).sum(axis=-2) / np.where(count, count, np.nan)
    high = np.where(known, exact, -np.inf).max(axis=-2)
    low = np.where(known, exact, np.inf).min(axis=-2)
    return middle, np.where(count > 0, high - low, 0.0).max(axis=-1)


def _overlaps(exact: np.ndarray, there: np.ndarray, faults: CrowdFaults) -> dict[tuple[int, int], np.ndarray]:
    """Return, per pair of people, where they overlap, shape (frame, view), bool."""
    middle, height = _middle_and_height(exact)
    found = {}
    for p, q in combinations(range(exact.shape[2]), 2):
        apart = np.linalg.norm(middle[:, :, p] - middle[:, :, q], axis=-1)
        near = apart < faults.merge_distance * 0.5 * (height[:, :, p] + height[:, :, q])
        # A detector does not take people of very different size for one.
        alike = np.minimum(height[:, :, p], height[:, :, q]) > 0.6 * np.maximum(height[:, :, p], height[:, :, q])
        found[p, q] = near & alike & there[:, :, p] & there[:, :, q]
    return found


def _take_limbs(
    people: DetectionSlots,
    overlaps: dict[tuple[int, int], np.ndarray],
    behind: np.ndarray,
    skeleton: Skeleton,
    rate_hz: float,
    faults: CrowdFaults,
    rng: np.random.Generator,
) -> None:
    """Replace occluded limbs of people by those of the person who overlaps them, for intervals."""
    shape = people.there.shape[:2]
    pixels, confidence = people.pixels.copy(), people.confidence.copy()
    for pair, overlap in overlaps.items():
        for p, q in (pair, pair[::-1]):
            for limb in _limbs(skeleton):
                occluded = 2 * behind[:, :, p][..., limb].sum(axis=-1) > len(limb)
                taken = overlap & occluded & on_intervals(shape, faults.taken_share, _MERGE_DWELL_S, rate_hz, rng)
                frame, view = (each[:, None] for each in np.nonzero(taken))
                people.pixels[frame, view, p, limb] = pixels[frame, view, q, limb]
                people.confidence[frame, view, p, limb] = confidence[frame, view, q, limb]


def _limbs(skeleton: Skeleton) -> list[np.ndarray]:
    """Return the keypoints of each arm and each leg, shape (keypoint,), int64."""
    return [
        np.array([skeleton.index(pair[side]) for pair in chain])
        for chain in skeleton.chains.values()
        for side in range(2)
    ]


def _merge(
    people: DetectionSlots,
    overlaps: dict[tuple[int, int], np.ndarray],
    staging: Staging,
    rate_hz: float,
    faults: CrowdFaults,
    rng: np.random.Generator,
) -> None:
    """Merge two people into one detection where they overlap, for intervals."""
    shape = people.there.shape[:2]
    taken = np.zeros(people.there.shape, dtype=bool)
    for (p, q), overlap in overlaps.items():
        merged = overlap & on_intervals(shape, faults.merge_share, _MERGE_DWELL_S, rate_hz, rng)
        if staging.spared_view >= 0:
            merged[:, staging.spared_view] = False
        if (p, q) == (0, 1):
            merged |= staging.merged[:, None] & (people.there[:, :, p] | people.there[:, :, q])
        merged &= ~taken[:, :, p] & ~taken[:, :, q]
        taken[:, :, p] |= merged
        taken[:, :, q] |= merged
        _mix_keypoints(people, p, q, merged, rate_hz, rng)


def _mix_keypoints(
    people: DetectionSlots, p: int, q: int, merged: np.ndarray, rate_hz: float, rng: np.random.Generator
) -> None:
    """Fill the first slot with keypoints of either person, with correlated choice, and empty the second."""
    if not merged.any():
        return
    one, two = people.pixels[:, :, p], people.pixels[:, :, q]
    have_one, have_two = np.isfinite(one[..., 0]), np.isfinite(two[..., 0])
    # One of them tends to give most of it.
    lead = rng.normal(0.0, 0.7, (1, one.shape[1], 1))
    from_one = (correlated_noise(one.shape[:3], rate_hz, rng) + lead > 0) & have_one | ~have_two
    here = merged[..., None]
    pixels = np.where(from_one[..., None], one, two)
    confidence = np.where(from_one, people.confidence[:, :, p], people.confidence[:, :, q])
    given_one, given_two = (from_one & have_one).sum(axis=-1), (~from_one & have_two).sum(axis=-1)
    first = given_one >= given_two
    for values, mixed in ((people.pixels, pixels), (people.confidence, confidence)):
        cells = here[..., None] if values.ndim == 5 else here
        values[:, :, p] = np.where(cells, mixed, values[:, :, p])
    ids = np.where(first, people.ids[:, :, p], people.ids[:, :, q])
    people.ids[:, :, p] = np.where(merged, ids, people.ids[:, :, p])
    people.owner[:, :, p] = np.where(merged, np.where(first, p, q), people.owner[:, :, p])
    people.other[:, :, p] = np.where(merged, np.where(first, q, p), people.other[:, :, p])
    people.kind[:, :, p] = np.where(merged, int(Kind.MERGED), people.kind[:, :, p])
    people.pixels[:, :, q][merged] = np.nan
    people.confidence[:, :, q][merged] = np.nan


def _duplicates(
    people: DetectionSlots, sizes: np.ndarray, rate_hz: float, faults: CrowdFaults, rng: np.random.Generator
) -> DetectionSlots:
    """Return second detections of people: displaced, less confident, two fifths of the keypoints missing."""
    shape = people.confidence.shape
    doubled = on_intervals(shape[:3], faults.duplicate_share, _DUPLICATE_DWELL_S, rate_hz, rng)
    doubled &= people.there & (people.kind == Kind.PERSON)
    shake = _JITTER_PX_AT_1000 * sizes[:, 0] / 1000.0
    pixels = people.pixels + shake[:, None, None, None] * correlated_noise((*shape, 2), rate_hz, rng)
    keep = doubled[..., None] & ~on_intervals(shape, 0.4, _DUPLICATE_DWELL_S, rate_hz, rng)
    return DetectionSlots.of(
        np.where(keep[..., None], pixels, np.nan),
        np.where(keep, 0.8 * people.confidence, np.nan),
        np.where(people.owner >= 0, people.owner, -1),
        Kind.DUPLICATE,
    )


def _false_people(
    exact: np.ndarray, sizes: np.ndarray, rate_hz: float, faults: CrowdFaults, rng: np.random.Generator
) -> DetectionSlots:
    """Return false people in one view (poster, coat, mirror), standing or drifting for an interval.

    Their poses are those of people at another time in some view, with another size and position.
    """
    n_frames, n_views, _, n_keypoints, _ = exact.shape
    shape = (n_frames, n_views, _FALSE_PER_VIEW)
    pixels = np.full((*shape, n_keypoints, 2), np.nan)
    confidence = np.full((*shape, n_keypoints), np.nan)
    # A view shows a false person if either slot does.
    share = 1.0 - (1.0 - faults.false_share) ** (1.0 / _FALSE_PER_VIEW)
    on = on_intervals(shape, share, _FALSE_DWELL_S, rate_hz, rng)
    whole = np.isfinite(exact).all(axis=(3, 4))
    places = np.argwhere(whole)
    starts = on & ~np.concatenate([np.zeros((1, *shape[1:]), dtype=bool), on[:-1]])
    for first, view, slot in np.argwhere(starts) if len(places) else ():
        off = np.flatnonzero(~on[first:, view, slot])
        frames = slice(first, first + off[0] if len(off) else n_frames)
        pose = exact[tuple(places[rng.integers(len(places))])]
        length = frames.stop - first
        pixels[frames, view, slot] = _false_pose(pose, sizes[view], np.arange(length) / rate_hz, rng)
        sure = np.clip(rng.uniform(0.25, 0.7) + 0.1 * correlated_noise((length, n_keypoints), rate_hz, rng), 0.05, 0.95)
        confidence[frames, view, slot] = sure
        gone = rng.random(n_keypoints) < 0.25
        pixels[frames, view, slot, gone] = np.nan
    outside = ((pixels < -0.5) | (pixels > sizes[:, None, None] - 0.5)).any(axis=-1)
    pixels[outside] = np.nan
    confidence[~np.isfinite(pixels[..., 0])] = np.nan
    return DetectionSlots.of(pixels, confidence, -1, Kind.FALSE)


def _false_pose(pose: np.ndarray, size: np.ndarray, time_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a pose with random size and position, standing or drifting, shape (time, keypoint, 2)."""
    centered = pose - pose.mean(axis=0)
    extent = max(float(np.ptp(centered, axis=0).max()), 1.0)
    scale = size[1] * rng.uniform(0.15, 0.45) / extent
    place = size * rng.uniform(0.15, 0.85, 2)
    drift = rng.normal(0.0, _FALSE_DRIFT_PX_S, 2) * (rng.random() < 0.5)
    shake = rng.normal(0.0, 1.5, (len(time_s), len(pose), 2))
    return place + scale * centered + drift * time_s[:, None, None] + shake


def _identities(
    there: np.ndarray,
    overlaps: dict[tuple[int, int], np.ndarray],
    rate_hz: float,
    faults: CrowdFaults,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return 2D identities per view, shape (frame, view, person), which change and are swapped at random."""
    n_frames, n_views, n_people = there.shape
    renewed = rng.random(there.shape) < faults.id_change_hz / rate_hz
    renewed |= _reappears_after(there, round(0.5 * rate_hz))
    which = np.broadcast_to(np.arange(n_people), there.shape).copy()
    for (p, q), overlap in overlaps.items():
        ends = overlap[:-1] & ~overlap[1:]
        for frame, view in np.argwhere(ends & (rng.random(ends.shape) < faults.id_swap_share)):
            which[frame + 1 :, view, [p, q]] = which[frame + 1 :, view, [q, p]]
    generation = np.take_along_axis(np.cumsum(renewed, axis=0), which, axis=2)
    keys = (which.astype(np.int64), generation)
    ids = np.empty(there.shape, dtype=np.int64)
    for view in range(n_views):
        pairs = np.stack([key[:, view].ravel() for key in keys], axis=1)
        ids[:, view] = np.unique(pairs, axis=0, return_inverse=True)[1].reshape(n_frames, n_people)
    return ids


def _reappears_after(there: np.ndarray, n_frames: int) -> np.ndarray:
    """Return where a person is detected again after more than ``n_frames`` frames."""
    frame = np.arange(len(there))[:, None, None]
    last = np.maximum.accumulate(np.where(there, frame, -1), axis=0)
    before = np.concatenate([np.full((1, *there.shape[1:]), -1), last[:-1]])
    return there & (before >= 0) & (frame - before > n_frames)


def _identify_false_detections(doubles: DetectionSlots, false_people: DetectionSlots, last: int) -> None:
    """Set identities of duplicates and false people: one per slot of a view."""
    for part in (doubles, false_people):
        n_slots = part.ids.shape[2]
        part.ids[:] = last + 1 + np.arange(n_slots)
        last += n_slots


def _rows(
    parts: list[DetectionSlots],
    rig: CameraRig,
    skeleton: Skeleton,
    rate_hz: float,
    faults: CrowdFaults,
    rng: np.random.Generator,
) -> CrowdDetections:
    """Sort all slots into rows by frame, view and detector order."""
    there = np.concatenate([part.there for part in parts], axis=2)
    n_frames, n_views, _ = there.shape
    order = rng.random(there.shape) if faults.shuffled else np.broadcast_to(np.arange(there.shape[2]), there.shape)
    slots = np.argsort(np.where(there, order, np.inf), axis=2)
    kept = np.take_along_axis(there, slots, axis=2)
    frame, view, place = np.nonzero(kept)
    cells = (frame, view, slots[frame, view, place])

    def rows(name: str) -> np.ndarray:
        return np.concatenate([getattr(part, name) for part in parts], axis=2)[cells]

    detections = Detections(
        skeleton=skeleton,
        view_names=rig.names,
        frame_numbers=np.arange(n_frames),
        time_s=frame_times(np.arange(n_frames), n_views, rate_hz),
        offsets=np.concatenate([[0], np.cumsum(there.sum(axis=2).ravel())]),
        keypoints_px=rows("pixels"),
        confidence=rows("confidence"),
        recorded=np.ones((n_frames, n_views), dtype=bool),
        track_ids=rows("ids"),
        rate_hz=rate_hz,
        notes=("Simulated.",),
    )
    return CrowdDetections(detections, rows("owner"), rows("other"), rows("kind"))
