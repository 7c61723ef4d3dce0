"""Time offsets of all views from the delays of their sounds, pair by pair."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy.sparse.csgraph import connected_components

from posefuse.calibration.sound.delay import MIN_OVERLAP_S, Delay, measure_delay
from posefuse.calibration.sound.onsets import find_onsets
from posefuse.errors import choices
from posefuse.model.clock_evidence import ClockEvidence
from posefuse.model.sound import Sound
from posefuse.progress import Progress

_SYSTEMATIC_SD_S = 0.01
"""Standard deviation of what a delay of sounds does not show: 2 m of different distance to the source are 6 ms, and
cameras record sound some milliseconds before or after the images."""
_CONTRADICTION_S, _CONTRADICTION_Z = 0.03, 5.0
_DRIFT_Z, _DRIFT_S = 3.0, 0.002


def time_by_sound(sounds: Sequence[Sound], reference: str | None, progress: Progress) -> tuple[ClockEvidence, ...]:
    """Return the evidence of sound on the clock of every view; offsets count from its first image.

    Views without evidence (no sound, silence, or sound that no other view recorded) have a reason and no offset.

    Args:
        sounds: the sound of each view.
        reference: view whose clock is correct; by default the one that started first.
        progress: receives the progress.
    """
    usable = [v for v, sound in enumerate(sounds) if not sound.problem and sound.duration_s >= MIN_OVERLAP_S]
    onsets = {v: find_onsets(sounds[v]) for v in usable}
    pairs = list(combinations(usable, 2))
    progress.start("comparing sounds", len(pairs))
    delays: dict[tuple[int, int], Delay | None] = {}
    for a, b in pairs:
        delays[a, b] = measure_delay((sounds[a], sounds[b]), (onsets[a], onsets[b]))
        progress.advance(1)
    progress.finish()
    decisive = _consistent({pair: delay for pair, delay in delays.items() if delay is not None and delay.is_decisive})
    group, root = _group(len(sounds), decisive, _index(sounds, reference))
    solution = _solve(group, decisive, root)
    if reference is None and group:
        # The view that started first has offset 0.
        solution = {v: (offset - min(o for o, _, _ in solution.values()), sd, drift)
                    for v, (offset, sd, drift) in solution.items()}  # fmt: skip
    return tuple(_timing(v, sounds, solution, delays, decisive) for v in range(len(sounds)))


def _index(sounds: Sequence[Sound], name: str | None) -> int | None:
    return next((v for v, sound in enumerate(sounds) if sound.view == name), None)


def _consistent(delays: dict[tuple[int, int], Delay]) -> dict[tuple[int, int], Delay]:
    """Leave out delays that contradict the others, the worst first."""
    kept = dict(delays)
    while len(kept) > 2:
        nodes = sorted({v for pair in kept for v in pair})
        offsets = _least_squares(kept, nodes)[0]
        at = dict(zip(nodes, offsets, strict=True))
        errors = {(a, b): abs(at[b] - at[a] - kept[a, b].offset_s) for a, b in kept}
        worst = max(errors, key=lambda pair: errors[pair])
        if errors[worst] <= max(_CONTRADICTION_S, _CONTRADICTION_Z * kept[worst].sd_s):
            break
        # Of the delays of a wrong loop, the least certain one is wrong.
        loop = [pair for pair in kept if errors[pair] >= 0.5 * errors[worst]]
        del kept[max(loop, key=lambda pair: (kept[pair].chance, errors[pair]))]
    return kept


def _group(n: int, delays: dict[tuple[int, int], Delay], reference: int | None) -> tuple[list[int], int]:
    """Return the views that delays connect with the reference, or the largest such group, and its first view."""
    linked = np.zeros((n, n), dtype=bool)
    for a, b in delays:
        linked[a, b] = True
    labels = connected_components(linked, directed=False)[1] if n else np.empty(0, dtype=int)
    sizes = np.bincount(labels, minlength=1)
    chosen = labels[reference] if reference is not None else int(np.argmax(sizes))
    group = np.flatnonzero(labels == chosen).tolist()
    if len(group) < 2:
        return [], 0
    return group, reference if reference is not None else group[0]


def _least_squares(delays: dict[tuple[int, int], Delay], nodes: list[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return offsets, drifts (1) of all nodes relative to the first, and the covariance of the offsets."""
    place = {v: i for i, v in enumerate(nodes)}
    design = np.zeros((len(delays), len(nodes)))
    values, drifts, weights = [], [], []
    for row, ((a, b), delay) in enumerate(delays.items()):
        design[row, place[a]], design[row, place[b]] = -1.0, 1.0
        # Delays of different sources differ by milliseconds.
        values.append(delay.offset_s - 1e-6 * delay.drift_ppm * delay.middle_s)
        drifts.append(1e-6 * delay.drift_ppm)
        weights.append(1.0 / (delay.sd_s**2 + 1e-6))
    weight = np.array(weights)
    normal = design.T @ (weight[:, None] * design)
    inverse = np.linalg.pinv(normal)
    offsets = inverse @ (design.T @ (weight * np.array(values)))
    rates = inverse @ (design.T @ (weight * np.array(drifts)))
    relative = np.eye(len(nodes))
    relative[:, 0] -= 1.0
    return offsets - offsets[0], rates - rates[0], relative @ inverse @ relative.T


def _solve(group: list[int], delays: dict[tuple[int, int], Delay], root: int) -> dict[int, tuple[float, float, float]]:
    """Return offset, standard deviation and drift of each view of a group, relative to its root."""
    if not group:
        return {}
    nodes = [root, *(v for v in group if v != root)]
    inside = {pair: _without_weak_drift(delay) for pair, delay in delays.items() if pair[0] in nodes}
    offsets, rates, covariance = _least_squares(inside, nodes)
    sds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    rates = np.where(np.abs(rates) < 1e-9, 0.0, rates)
    return {v: (float(offsets[i]), float(sds[i]), 1e6 * float(rates[i])) for i, v in enumerate(nodes)}


def _without_weak_drift(delay: Delay) -> Delay:
    """Return a delay without a drift that is not significant or moves the offset by less than 2 ms."""
    moved_s = 2e-6 * abs(delay.drift_ppm) * delay.middle_s
    if abs(delay.drift_ppm) > _DRIFT_Z * delay.drift_sd_ppm and moved_s > _DRIFT_S:
        return delay
    return replace(delay, drift_ppm=0.0)


def _timing(
    v: int,
    sounds: Sequence[Sound],
    solution: dict[int, tuple[float, float, float]],
    delays: dict[tuple[int, int], Delay | None],
    decisive: dict[tuple[int, int], Delay],
) -> ClockEvidence:
    name = sounds[v].view
    mine = [delay for pair, delay in delays.items() if v in pair]
    if v in solution:
        offset_s, sd_s, drift_ppm = solution[v]
        best = max((delay for pair, delay in decisive.items() if v in pair), key=lambda delay: delay.n_agreeing)
        reason = f"{best.n_agreeing} of {best.n_windows} pieces of sound agree."
        total_sd_s = float(np.hypot(sd_s, _SYSTEMATIC_SD_S))
        return ClockEvidence(name, "sound", offset_s, total_sd_s, drift_ppm, reason)
    reason = _why_not(sounds[v], mine, sounds, bool(solution))
    return ClockEvidence(name, "sound", np.nan, np.nan, 0.0, reason)


def _why_not(sound: Sound, delays: list[Delay | None], sounds: Sequence[Sound], others: bool) -> str:
    """Return why a view has no evidence."""
    if sound.problem:
        return f"{sound.view} {sound.problem}."
    if sound.duration_s < MIN_OVERLAP_S:
        return f"The sound of {sound.view} is too short ({sound.duration_s:.1f} s of {MIN_OVERLAP_S:g} s)."
    if not delays:
        silent = [other.view for other in sounds if other is not sound]
        return f"No other view has sound to compare with: {choices(silent)}." if silent else "There is no other view."
    known = [delay for delay in delays if delay is not None]
    if any(delay.rival_s is not None for delay in known):
        gap_s = min(abs(delay.offset_s - delay.rival_s) for delay in known if delay.rival_s is not None)
        return f"The sound of {sound.view} repeats: offsets {gap_s:.2f} s apart explain it equally well."
    if others and any(delay.is_decisive for delay in known):
        return f"The sound of {sound.view} is connected with other views than the reference only."
    if any(delay.is_hinted for delay in known):
        return f"The sound of {sound.view} agrees with another in too few places to decide; record more sound."
    return f"The sound of {sound.view} does not agree with that of any other view."
