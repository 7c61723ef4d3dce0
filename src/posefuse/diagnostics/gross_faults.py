"""What is badly wrong with single views: images turned or resized, sides exchanged, frames late, another's camera.

Each guess is judged by how well the view then agrees with the others (:mod:`posefuse.diagnostics.epipolar`); the best is
taken while it helps much. Only views that disagree are asked, so that a healthy recording costs one table.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np

from posefuse.diagnostics import epipolar
from posefuse.diagnostics.epipolar import Look, disagreement, look_of
from posefuse.diagnostics.observations import Evidence
from posefuse.diagnostics.points import TAILS, Points, solve_points, usual_noise
from posefuse.diagnostics.start_offsets import offsets_of_pairs, or_inf
from posefuse.diagnostics.state import Image, State, look
from posefuse.model.cameras import rotation_from_vector

_SCALES = (0.7, 1.0, 1.4, 2.0, 2.8)
_HEALTHY = 0.26
AGREES = 0.4
_SUSPECT = 0.04
_LEAST_GAIN = 0.05
_SAME = 0.02
_LEAST_ZOOM = 0.08
_SCANNED = 3
"""Of the samples every third is looked at while values are tried one after the other."""
_GROSS = 0.2
"""What a turned or resized image gains at least."""
_FAR, _FAR_AT_LEAST = 0.15, 0.45
_SIZES = tuple(np.round(np.exp(np.linspace(np.log(0.25), np.log(4.0), 57)), 3))
_COMMON_SIZES = (0.25, 1 / 3, 0.375, 0.5, 2 / 3, 0.75, 0.8, 1.25, 4 / 3, 1.5, 2.0, 8 / 3, 3.0, 4.0)
_FOCALS = tuple(np.round(np.exp(np.linspace(np.log(0.2), np.log(5.0), 47)), 3))
_MOST_VIEWS_TO_ORDER = 7


@dataclass(frozen=True)
class Guess:
    """What is badly wrong with a view.

    Attributes:
        kind: ``image``, ``sides``, ``late``, ``focal``, ``order``, ``pose``.
        view: of whom; -1 where it is all of them, or several change cameras.
        state: what is believed with it.
        before: how much the view disagreed with the others, 0 to 1.
        after: how much it does then.
    """

    kind: str
    view: int
    state: State
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Coarse:
    """What the coarse search ends with.

    Attributes:
        state: what is believed.
        guesses: one after the other.
        table: shape (view, view): how much views disagree in the end.
        first: shape (view, view): how much they disagreed.
        scale: of the noise, as a multiple of the usual.
        agreed: whether enough views agree in the end for the rest to be measured against them.
    """

    state: State
    guesses: tuple[Guess, ...]
    table: np.ndarray
    first: np.ndarray
    scale: float
    agreed: bool


def search(evidence: Evidence, frames: np.ndarray, reach_s: float) -> Coarse:
    """Guess while it helps.

    Args:
        evidence: the recording.
        frames: to look at, some hundred.
        reach_s: how late views may be.
    """
    state = State.given(evidence, frames)
    scale = _noise_of_the_best(evidence, state)
    asked = _Asked(evidence, scale, reach_s)
    table = first = asked.table(state)
    guesses: list[Guess] = []
    apart = _unsynchronised(asked, state, table) if scale > 1.0 else None
    if apart is not None:
        asked, guess = apart
        guesses, state, scale, table = [guess], guess.state, asked.scale, asked.table(guess.state)
    for _ in range(2 * evidence.n_views):
        guess = asked.best(state, table)
        if guess is None:
            break
        guesses.append(guess)
        state = guess.state
        table = asked.table(state)
    return Coarse(state, tuple(guesses), table, first, scale, _core(table))


def _unsynchronised(asked: "_Asked", state: State, table: np.ndarray) -> "tuple[_Asked, Guess] | None":
    """That every camera was started alone, where all then agree as with less noise; None where they do not."""
    tried = replace(asked, scale=1.0).started(state)
    scale = _noise_of_the_best(asked.evidence, tried)
    calmer = replace(asked, scale=scale)
    after = calmer.table(tried)
    rows = _row_levels(after)
    if scale >= asked.scale or not _core(after) or (rows[np.isfinite(rows)] >= AGREES).any():
        return None
    return calmer, Guess("late", -1, tried, _mean(table), _mean(after))


def _noise_of_the_best(evidence: Evidence, state: State) -> float:
    """A noise at which a quarter of the pairs of views agree, so that one bad view does not hide behind it."""
    sight = look(evidence, state)
    for scale in _SCALES:
        table = epipolar.table(epipolar.looks(evidence, state, sight, scale))
        known = table[np.isfinite(table)]
        if len(known) and np.quantile(known, 0.25) < _HEALTHY:
            return scale
    return 1.0


def _core(table: np.ndarray) -> bool:
    """Whether some views agree among themselves: three of them, or of three cameras two."""
    views = len(table)
    if views == 2:
        return bool(table[0, 1] < AGREES)
    size = 2 if views == 3 else 3
    return any(all(table[a, b] < AGREES for a, b in combinations(some, 2)) for some in combinations(range(views), size))


@dataclass(frozen=True, eq=False)
class _Asked:
    evidence: Evidence
    scale: float
    reach_s: float

    def table(self, state: State) -> np.ndarray:
        return epipolar.table(self.looks(state))

    def looks(self, state: State) -> list[Look]:
        return epipolar.looks(self.evidence, state, look(self.evidence, state), self.scale)

    def best(self, state: State, table: np.ndarray) -> Guess | None:
        """The guess that helps most, or None where none helps."""
        views = len(table)
        rows = _row_levels(table)
        level = float(np.nanquantile(table, 0.25)) if np.isfinite(table).any() else np.nan
        suspects = [v for v in range(views) if rows[v] > level + _SUSPECT]
        if len(suspects) > 1 or not _core(table):
            ordered = self._ordered(state, table)
            if ordered is not None:
                return ordered
        if views > 2 and _core(table):
            found = [guess for v in suspects for guess in self._simple(state, table, v)]
            chosen = _choose(found, level)
            if chosen is not None:
                return chosen
        if not _core(table):
            return _choose(list(self._together(state, table)), level)
        if views > 2:
            far = [v for v in suspects if rows[v] > max(level + _FAR, _FAR_AT_LEAST)]
            return _choose([guess for v in far for guess in self._posed(state, table, v)], level)
        return _choose(list(self._simple(state, table, 1)), level)

    def _judged(self, kind: str, view: int, state: State, table: np.ndarray, others: list[Look]) -> Guess:
        mine = look_of(self.evidence, state, view, self.scale)
        row = [np.nan if u == view else disagreement(mine, others[u]) for u in range(len(others))]
        return Guess(kind, view, state, _level(table[view]), _level(np.array(row)))

    def _simple(self, state: State, table: np.ndarray, v: int) -> Iterator[Guess]:
        """Guesses about one view that change neither its place nor anybody else."""
        others = self.looks(state)
        few = state.frames[::_SCANNED]
        few_others = self.looks(state.at(few))

        def judged(kind: str, tried: State) -> Guess:
            return self._judged(kind, v, tried, table, others)

        def best_of(kind: str, states: list[State]) -> Guess:
            scanned = [or_inf(self._judged(kind, v, tried.at(few), table, few_others).after) for tried in states]
            return judged(kind, states[int(np.argmin(scanned))])

        was = state.images[v]
        for turns in range(4):
            for mirrored in (False, True):
                if (turns, mirrored) != (0, False):
                    image = replace(was, turns=(was.turns + turns) % 4, mirrored=was.mirrored != mirrored)
                    yield judged("image", state.with_image(v, image))
        yield judged("sides", state.with_sides(v, not state.swapped[v]))
        for sizes in (_COMMON_SIZES, _SIZES):
            tried = [
                state.with_image(v, replace(was, scale=was.scale * s)) for s in sizes if abs(np.log(s)) > _LEAST_ZOOM
            ]
            yield best_of("image", tried)
        rough = best_of("focal", [state.with_focal(v, f) for f in _FOCALS])
        zoom = best_of("focal", [rough.state.with_focal(v, 1.0 + 0.005 * k) for k in range(-7, 8)])
        # Little is for the fine search, which knows how certain it is.
        if abs(float(np.log(zoom.state.focal[0, v, 0] / state.focal[0, v, 0]))) > _LEAST_ZOOM:
            yield zoom
        step = max(self.evidence.period_s, 0.04)
        reach = int(self.reach_s / step)
        tried = [state.with_late(v, step * k) for k in range(-reach, reach + 1) if k]
        if tried:
            late = best_of("late", tried)
            fine = [late.state.with_late(v, 0.25 * step * k) for k in range(-3, 4)]
            yield best_of("late", fine)

    def _posed(self, state: State, table: np.ndarray, v: int) -> Iterator[Guess]:
        pose = relocated(self.evidence, state, v, self.scale)
        if pose is not None:
            yield self._judged("pose", v, state.with_pose(v, pose), table, self.looks(state))

    def _together(self, state: State, table: np.ndarray) -> Iterator[Guess]:
        """Guesses about all views at once."""
        before = _mean(table)
        images = [Image(turns, mirrored) for turns in range(4) for mirrored in (False, True)]
        images += [Image(scale=s) for s in _COMMON_SIZES]
        for image in images:
            tried = replace(state, images=(image,) * self.evidence.n_views)
            yield Guess("image", -1, tried, before, _mean(self.table(tried)))
        for factor in _FOCALS[::2]:
            tried = replace(state, focal=state.focal * factor)
            yield Guess("focal", -1, tried, before, _mean(self.table(tried)))
        tried = self.started(state)
        after = self.table(tried)
        if _core(after):
            yield Guess("late", -1, tried, before, _mean(after))

    def started(self, state: State) -> State:
        """Every camera started when it agrees best with the others."""
        step = max(self.evidence.period_s, 0.04)
        late_s = offsets_of_pairs(self.evidence, state, self.scale, step, int(self.reach_s / step))
        for v, late in enumerate(late_s):
            state = state.with_late(v, late)
        return state

    def _ordered(self, state: State, table: np.ndarray) -> Guess | None:
        """The best order of cameras, if it is another."""
        costs = self._costs(state)
        order = _best_order(costs, state.cameras)
        if order == state.cameras:
            return None
        tried = state
        for v, camera in enumerate(order):
            if camera != state.cameras[v]:
                tried = tried.with_camera(self.evidence, v, camera)
        moved = [v for v in range(len(order)) if order[v] != state.cameras[v]]
        after = self.table(tried)
        gain = Guess("order", -1, tried, *(float(np.nanmean([_level(t[v]) for v in moved])) for t in (table, after)))
        return gain if gain.before - gain.after > 2.0 * _LEAST_GAIN and gain.after < AGREES else None

    def _costs(self, state: State) -> np.ndarray:
        """Shape (view, camera, view, camera): disagreement of every pair with every pair of cameras."""
        evidence, views = self.evidence, self.evidence.n_views
        few = state.at(state.frames[:: max(1, len(state.frames) // 30)])
        seen = {}
        for v in range(views):
            for c in range(views):
                tried = few.with_camera(evidence, v, c)
                seen[v, c] = look_of(evidence, tried, v, self.scale)
        costs = np.full((views,) * 4, np.nan)
        for a, b in combinations(range(views), 2):
            for c, d in permutations(range(views), 2):
                costs[a, c, b, d] = costs[b, d, a, c] = disagreement(seen[a, c], seen[b, d])
        return costs


def _choose(guesses: list[Guess], level: float) -> Guess | None:
    """The guess that leaves least disagreement; of those that leave as little the simplest, which comes first."""
    enough = [(g, max(_GROSS if g.kind == "image" else _LEAST_GAIN, 0.5 * (g.before - level))) for g in guesses]
    helping = [g for g, least in enough if g.before - g.after > least]
    if not helping:
        return None
    most = max(g.before - g.after for g in helping)
    return next(g for g in helping if g.before - g.after > most - _SAME)


def _row_levels(table: np.ndarray) -> np.ndarray:
    return np.array([_level(row) for row in table])


def _mean(table: np.ndarray) -> float:
    """Of all pairs; NaN where none has enough in common."""
    known = table[np.isfinite(table)]
    return float(known.mean()) if len(known) else np.nan


def _level(row: np.ndarray) -> float:
    """How much a view disagrees with the others, the worst third of them left out: those may be wrong themselves."""
    known = np.sort(row[np.isfinite(row)])
    if not len(known):
        return np.nan
    return float(known[: max(1, -(-2 * len(known) // 3))].mean())


def _best_order(costs: np.ndarray, start: tuple[int, ...]) -> tuple[int, ...]:
    views = len(costs)
    known = np.where(np.isfinite(costs), costs, np.nanmean(costs))

    def total(order: tuple[int, ...]) -> float:
        return sum(known[a, order[a], b, order[b]] for a, b in combinations(range(views), 2))

    best = start
    if views <= _MOST_VIEWS_TO_ORDER:
        candidates = np.array(list(permutations(range(views))))
        sums = sum(known[a, candidates[:, a], b, candidates[:, b]] for a, b in combinations(range(views), 2))
        found = tuple(int(c) for c in candidates[int(np.argmin(sums))])
        return found if total(found) < total(start) - 1e-9 else start
    while True:
        swaps = []
        for a, b in combinations(range(views), 2):
            order = list(best)
            order[a], order[b] = order[b], order[a]
            swaps.append(tuple(order))
        found = min(swaps, key=total)
        if total(found) >= total(best) - 1e-9:
            return best
        best = found


def relocated(evidence: Evidence, state: State, view: int, scale: float) -> np.ndarray | None:
    """Shape (4, 4): where a view's camera stands by what the others see, or None where too little tells."""
    sight = look(evidence, state)
    hidden = sight.at.copy()
    hidden[:, :, view] = np.nan
    points = solve_points(evidence, state, replace(sight, at=hidden), scale)
    world = points.points_m.reshape(-1, 3)
    at = sight.at[:, :, view].reshape(-1, 2)
    sigma = (usual_noise(evidence, sight) * scale)[:, :, view].ravel()
    good = np.isfinite(world).all(axis=-1) & np.isfinite(at).all(axis=-1) & _checked(points).ravel()
    if good.sum() < 60:
        return None
    starts = [state_pose(state, view)]
    direct = _direct(world[good], at[good])
    if direct is not None:
        starts.append(direct)
    found = [_annealed(world[good], at[good], sigma[good], start) for start in starts]
    return min(found, key=lambda pose: _loss(world[good], at[good], sigma[good], pose))


def state_pose(state: State, view: int) -> np.ndarray:
    """Shape (4, 4): where a view's camera stands in the middle of the recording."""
    middle, pose = len(state.frames) // 2, np.eye(4)
    pose[:3, :3], pose[:3, 3] = state.rotation[middle, view], state.translation_m[middle, view]
    return pose


def _checked(points: Points) -> np.ndarray:
    agree = (points.weight > 0) & (np.square(points.residual).sum(axis=-1) < 9.0)
    return agree.sum(axis=-1) >= 2


def _direct(world: np.ndarray, at: np.ndarray) -> np.ndarray | None:
    """A pose by the direct linear transform, trimmed thrice."""
    kept = np.ones(len(world), dtype=bool)
    pose = None
    middle, size = np.median(world, axis=0), float(np.std(world)) or 1.0
    local = np.concatenate([(world - middle) / size, np.ones((len(world), 1))], axis=1)
    for _ in range(3):
        zero = np.zeros((kept.sum(), 4))
        some, u, v = local[kept], at[kept, :1], at[kept, 1:]
        rows = np.concatenate(
            [np.concatenate([some, zero, -u * some], axis=1), np.concatenate([zero, some, -v * some], axis=1)]
        )
        matrix = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 4)
        matrix = matrix * np.sign(np.median(local @ matrix[2]))
        left, strength, right = np.linalg.svd(matrix[:, :3])
        if strength[1] < 1e-9:
            return pose
        turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        shift = matrix[:, 3] / strength.mean() * size
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, shift - turn @ middle
        error = np.linalg.norm(_seen_from(world, pose) - at, axis=-1)
        kept = error <= np.nanquantile(error, 0.7)
        if kept.sum() < 12:
            return pose
    return pose


def _seen_from(world: np.ndarray, pose: np.ndarray) -> np.ndarray:
    inside = world @ pose[:3, :3].T + pose[:3, 3]
    return inside[:, :2] / np.where(inside[:, 2:] > 1e-6, inside[:, 2:], 1e-6)


def _annealed(world: np.ndarray, at: np.ndarray, sigma: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """The pose that fits best, robustly; the bound of errors narrows as it goes."""
    pose = pose.copy()
    for width in (*np.geomspace(64.0, 1.0, 13), 1.0, 1.0):
        inside = world @ pose[:3, :3].T + pose[:3, 3]
        good = inside[:, 2] > 1e-3
        x, y, z = inside[good].T
        noise = sigma[good] * width
        residual = (at[good] - np.stack([x / z, y / z], axis=1)) / noise[:, None]
        weight = (TAILS + 2.0) / (TAILS + np.square(residual).sum(axis=1))
        zero = np.zeros_like(x)
        by_point = np.stack([np.stack([1 / z, zero, -x / z**2], -1), np.stack([zero, 1 / z, -y / z**2], -1)], axis=1)
        turn = -np.stack(
            [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], axis=1
        )
        rows = np.concatenate([by_point @ turn, by_point], axis=-1) / noise[:, None, None]
        weighted = rows * weight[:, None, None]
        normal = np.einsum("nki,nkj->ij", weighted, rows)
        step = np.linalg.solve(normal + 1e-9 * np.trace(normal) * np.eye(6), np.einsum("nki,nk->i", weighted, residual))
        rotation = rotation_from_vector(step[:3])
        pose[:3, :3] = rotation @ pose[:3, :3]
        pose[:3, 3] = rotation @ pose[:3, 3] + step[3:]
    return pose


def _loss(world: np.ndarray, at: np.ndarray, sigma: np.ndarray, pose: np.ndarray) -> float:
    inside = world @ pose[:3, :3].T + pose[:3, 3]
    squared = np.square((_seen_from(world, pose) - at) / sigma[:, None]).sum(axis=1)
    return float(np.minimum(np.where(inside[:, 2] > 0, squared, np.inf), 16.0).mean())
