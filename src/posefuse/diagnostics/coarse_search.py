"""Find gross faults of single views: transformed images, swapped sides, time offsets, or another camera's calibration.

Each candidate correction is scored by how well the view then agrees with the others
(:mod:`posefuse.diagnostics.epipolar`). The best one is accepted as long as it helps substantially. Only views that
disagree are tested, so a fault-free recording costs one table of disagreements.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, permutations

import numpy as np

from posefuse.diagnostics import epipolar
from posefuse.diagnostics.best_order import best_order
from posefuse.diagnostics.camera_resection import resect_camera
from posefuse.diagnostics.coarse_correction import MIN_GAIN, CoarseCorrection, choose
from posefuse.diagnostics.epipolar import PosedView, disagreement, disagreement_table, posed_view
from posefuse.diagnostics.frame_rates import RATE_ERRORS, possible_errors, with_rate_error
from posefuse.diagnostics.normalized_views import normalize_views
from posefuse.diagnostics.observations import TrackedObservations
from posefuse.diagnostics.recording_model import ImageTransform, RecordingModel
from posefuse.diagnostics.start_offsets import estimate_start_offsets, nan_to_inf
from posefuse.diagnostics.work_budget import WorkBudget
from posefuse.parallel import ONE_JOB, Jobs

_NOISE_SCALES = (0.7, 1.0, 1.4, 2.0, 2.8)
_CLEARLY_AGREES = 0.26
AGREES = 0.4
"""Views with a lower disagreement than this agree."""
_SUSPECT_MARGIN = 0.04
_MIN_LOG_ZOOM = 0.08
_RATE_STRIDE = 3
"""Steps between the tested time offsets at the start."""
_SCAN_STRIDE = 3
"""Scan values on every third sample only."""
_RESECTION_MARGIN, _MIN_RESECTION_LEVEL = 0.15, 0.45
_IMAGE_SCALES = tuple(np.round(np.exp(np.linspace(np.log(0.25), np.log(4.0), 57)), 3))
_COMMON_IMAGE_SCALES = (0.25, 1 / 3, 0.375, 0.5, 2 / 3, 0.75, 0.8, 1.25, 4 / 3, 1.5, 2.0, 8 / 3, 3.0, 4.0)
_FOCAL_FACTORS = tuple(np.round(np.exp(np.linspace(np.log(0.2), np.log(5.0), 47)), 3))


@dataclass(frozen=True, eq=False)
class CoarseResult:
    """Hold the result of the coarse search.

    Attributes:
        model: recording model with all corrections.
        corrections: in the order of acceptance.
        table: shape (view, view): final disagreement of every pair of views.
        initial_table: shape (view, view): disagreement before any correction.
        noise_scale: noise as a multiple of the expected noise.
        views_agree: whether enough views finally agree to measure the others against them.
        skipped: what the search did not examine because it would take too long.
    """

    model: RecordingModel
    corrections: tuple[CoarseCorrection, ...]
    table: np.ndarray
    initial_table: np.ndarray
    noise_scale: float
    views_agree: bool
    skipped: tuple[str, ...] = ()


def search(
    observations: TrackedObservations,
    frames: np.ndarray,
    max_offset_s: float,
    max_comparisons: int,
    jobs: Jobs = ONE_JOB,
) -> CoarseResult:
    """Accept corrections as long as they help.

    Args:
        observations: of the recording.
        frames: about a hundred sampled frames.
        max_offset_s: largest time offset to consider, in seconds.
        max_comparisons: bound of the work, see :class:`WorkBudget`.
        jobs: processes that test the corrections of suspect views.
    """
    budget = WorkBudget(max_comparisons)
    model = RecordingModel.from_calibration(observations, frames)
    scale = _noise_of_best_pairs(observations, model)
    candidates = _CandidateSearch(observations, scale, max_offset_s, budget)
    table = initial_table = candidates.table(model)
    corrections: list[CoarseCorrection] = []
    unsynchronized = _unsynchronized(candidates, model, table) if scale > 1.0 and candidates.may_synchronize() else None
    if unsynchronized is not None:
        candidates, correction = unsynchronized
        corrections, model, scale, table = (
            [correction],
            correction.model,
            candidates.scale,
            candidates.table(correction.model),
        )
    for _ in range(2 * observations.n_views):
        correction = candidates.best(model, table, jobs)
        if correction is None:
            break
        corrections.append(correction)
        model = correction.model
        table = candidates.table(model)
    return CoarseResult(model, tuple(corrections), table, initial_table, scale, _has_core(table), tuple(budget.skipped))


def _unsynchronized(
    candidates: "_CandidateSearch", model: RecordingModel, table: np.ndarray
) -> "tuple[_CandidateSearch, CoarseCorrection] | None":
    """Return the correction that offsets all clocks if all views then agree at lower noise, else None."""
    tried = replace(candidates, scale=1.0).synchronized(model)
    scale = _noise_of_best_pairs(candidates.observations, tried)
    quieter = replace(candidates, scale=scale)
    after = quieter.table(tried)
    rows = _view_levels(after)
    if scale >= candidates.scale or not _has_core(after) or (rows[np.isfinite(rows)] >= AGREES).any():
        return None
    return quieter, CoarseCorrection("offset", -1, tried, _mean(table), _mean(after))


def _noise_of_best_pairs(observations: TrackedObservations, model: RecordingModel) -> float:
    """Return a noise scale at which a quarter of the pairs agree, so that one faulty view does not inflate it."""
    normalized = normalize_views(observations, model)
    for scale in _NOISE_SCALES:
        table = disagreement_table(epipolar.posed_views(observations, model, normalized, scale))
        known = table[np.isfinite(table)]
        if len(known) and np.quantile(known, 0.25) < _CLEARLY_AGREES:
            return scale
    return 1.0


def _has_core(table: np.ndarray) -> bool:
    """Return whether some views agree among themselves: three of them, or two of three cameras."""
    views = len(table)
    if views == 2:
        return bool(table[0, 1] < AGREES)
    size = 2 if views == 3 else 3
    return any(all(table[a, b] < AGREES for a, b in combinations(some, 2)) for some in combinations(range(views), size))


@dataclass(frozen=True, eq=False)
class _CandidateSearch:
    """Hold the constants of the coarse search and propose corrections."""

    observations: TrackedObservations
    scale: float
    max_offset_s: float
    budget: WorkBudget

    @property
    def _step_s(self) -> float:
        """Step of the search for time offsets."""
        return max(self.observations.period_s, 0.04)

    @property
    def _reach(self) -> int:
        """Number of steps of the search for time offsets, on either side."""
        return int(self.max_offset_s / self._step_s)

    def may_synchronize(self) -> bool:
        """Return whether the budget allows the search for the time offsets of all views, and count it."""
        views = self.observations.n_views
        work = (2 * self._reach + 1) * views * (views + 1) // 2 + 16 * views * views
        return self.budget.allow(work, "time offsets of all views")

    def may_examine(self, view: int) -> bool:
        """Return whether the budget allows the search for corrections of a single view, and count it."""
        tried = 30 + len(_COMMON_IMAGE_SCALES) + len(_IMAGE_SCALES) + len(_FOCAL_FACTORS) + 2 * self._reach
        tried += len(RATE_ERRORS) * (2 * self._reach // _RATE_STRIDE + 1)
        name = self.observations.rig.names[view]
        return self.budget.allow(tried * self.observations.n_views, f"image, focal length and time offset of {name!r}")

    def may_reorder(self) -> bool:
        """Return whether the budget allows the search for another order of the cameras, and count it."""
        views = self.observations.n_views
        pairs = views * (views - 1)
        return self.budget.allow(views * views + pairs * pairs // 6, "the order of the cameras")

    def may_change_all(self) -> bool:
        """Return whether the budget allows corrections that concern all views at once, and count them."""
        views = self.observations.n_views
        tried = 8 + len(_COMMON_IMAGE_SCALES) + len(_FOCAL_FACTORS) // 2
        return self.budget.allow(tried * views * (views + 1) // 2, "image and focal length of all views")

    def table(self, model: RecordingModel) -> np.ndarray:
        """Return the disagreement of all pairs of views."""
        return disagreement_table(self.posed_views(model))

    def posed_views(self, model: RecordingModel) -> list[PosedView]:
        """Return all views with their poses."""
        return epipolar.posed_views(self.observations, model, normalize_views(self.observations, model), self.scale)

    def best(self, model: RecordingModel, table: np.ndarray, jobs: Jobs) -> CoarseCorrection | None:
        """Return the most helpful correction, or None if none helps."""
        views = len(table)
        rows = _view_levels(table)
        level = float(np.nanquantile(table, 0.25)) if np.isfinite(table).any() else np.nan
        suspects = [v for v in range(views) if rows[v] > level + _SUSPECT_MARGIN]
        if len(suspects) > 1 or not _has_core(table):
            ordered = self._reordered(model, table) if self.may_reorder() else None
            if ordered is not None:
                return ordered
        if views > 2 and _has_core(table):
            examined = sorted(v for v in sorted(suspects, key=lambda v: -rows[v]) if self.may_examine(v))
            found = jobs.in_order(partial(self.of_view, model, table), examined)
            chosen = choose([correction for each in found for correction in each], level)
            if chosen is not None:
                return chosen
        if not _has_core(table):
            return choose(list(self._all_views(model, table)), level) if self.may_change_all() else None
        if views > 2:
            far = [v for v in suspects if rows[v] > max(level + _RESECTION_MARGIN, _MIN_RESECTION_LEVEL)]
            return choose([correction for v in far for correction in self._resected(model, table, v)], level)
        return choose(self.of_view(model, table, 1), level) if self.may_examine(1) else None

    def _scored(
        self, kind: str, view: int, model: RecordingModel, table: np.ndarray, others: list[PosedView]
    ) -> CoarseCorrection:
        """Return a correction with the view's disagreement before and after it."""
        mine = posed_view(self.observations, model, view, self.scale)
        row = [np.nan if u == view else disagreement(mine, others[u]) for u in range(len(others))]
        return CoarseCorrection(kind, view, model, _level(table[view]), _level(np.array(row)))

    def of_view(self, model: RecordingModel, table: np.ndarray, view: int) -> list[CoarseCorrection]:
        """Return corrections of one view that change neither its pose nor other views."""
        return list(self._single_view(model, table, view))

    def _single_view(self, model: RecordingModel, table: np.ndarray, v: int) -> Iterator[CoarseCorrection]:
        others = self.posed_views(model)
        few = model.frames[::_SCAN_STRIDE]
        few_others = self.posed_views(model.resampled(few))

        def scored(kind: str, tried: RecordingModel) -> CoarseCorrection:
            return self._scored(kind, v, tried, table, others)

        def best_of(kind: str, models: list[RecordingModel]) -> CoarseCorrection:
            scanned = [
                nan_to_inf(self._scored(kind, v, tried.resampled(few), table, few_others).after) for tried in models
            ]
            return scored(kind, models[int(np.argmin(scanned))])

        current = model.images[v]
        for turns in range(4):
            for mirrored in (False, True):
                if (turns, mirrored) != (0, False):
                    image = replace(
                        current,
                        quarter_turns=(current.quarter_turns + turns) % 4,
                        mirrored=current.mirrored != mirrored,
                    )
                    yield scored("image", model.with_image(v, image))
        yield scored("swap", model.with_swap(v, not model.swapped[v]))
        for sizes in (_COMMON_IMAGE_SCALES, _IMAGE_SCALES):
            tried = [
                model.with_image(v, replace(current, scale=current.scale * s))
                for s in sizes
                if abs(np.log(s)) > _MIN_LOG_ZOOM
            ]
            yield best_of("image", tried)
        rough = best_of("focal", [model.with_focal(v, f) for f in _FOCAL_FACTORS])
        zoom = best_of("focal", [rough.model.with_focal(v, 1.0 + 0.005 * k) for k in range(-7, 8)])
        # Leave small changes to the fine search, which estimates their uncertainty.
        if abs(float(np.log(zoom.model.focal_ratio[0, v, 0] / model.focal_ratio[0, v, 0]))) > _MIN_LOG_ZOOM:
            yield zoom
        step, reach = self._step_s, self._reach
        tried = [model.with_offset(v, step * k) for k in range(-reach, reach + 1) if k]
        if tried:
            coarse = best_of("offset", tried)
            fine = [coarse.model.with_offset(v, 0.25 * step * k) for k in range(-3, 4)]
            yield best_of("offset", fine)
        if _level(table[v]) > AGREES:
            yield self._other_rate(v, model, best_of)

    def _other_rate(
        self, v: int, model: RecordingModel, best_of: Callable[[str, list[RecordingModel]], CoarseCorrection]
    ) -> CoarseCorrection:
        """Return the best correction of a view's frame rate."""
        step, errors = self._step_s, possible_errors(self.observations.period_s)
        starts = [step * k for k in range(-self._reach, self._reach + 1, _RATE_STRIDE)]
        rough = [
            best_of("rate", [with_rate_error(self.observations, model, v, error, start_s) for start_s in starts])
            for error in errors
        ]
        place = int(np.argmin([nan_to_inf(each.after) for each in rough]))
        near = [rough[place].model.with_offset(v, 0.25 * step * k) for k in range(-8, 9)]
        return replace(best_of("rate", near), rate_error=errors[place])

    def _resected(self, model: RecordingModel, table: np.ndarray, v: int) -> Iterator[CoarseCorrection]:
        """Yield the correction of a view's pose."""
        pose = resect_camera(self.observations, model, v, self.scale)
        if pose is not None:
            yield self._scored("pose", v, model.with_pose(v, pose), table, self.posed_views(model))

    def _all_views(self, model: RecordingModel, table: np.ndarray) -> Iterator[CoarseCorrection]:
        """Yield corrections that concern all views at once."""
        before = _mean(table)
        images = [ImageTransform(turns, mirrored) for turns in range(4) for mirrored in (False, True)]
        images += [ImageTransform(scale=s) for s in _COMMON_IMAGE_SCALES]
        for image in images:
            tried = replace(model, images=(image,) * self.observations.n_views)
            yield CoarseCorrection("image", -1, tried, before, _mean(self.table(tried)))
        for factor in _FOCAL_FACTORS[::2]:
            tried = replace(model, focal_ratio=model.focal_ratio * factor)
            yield CoarseCorrection("focal", -1, tried, before, _mean(self.table(tried)))
        if not self.may_synchronize():
            return
        tried = self.synchronized(model)
        after = self.table(tried)
        if _has_core(after):
            yield CoarseCorrection("offset", -1, tried, before, _mean(after))

    def synchronized(self, model: RecordingModel) -> RecordingModel:
        """Return the model with the time offsets at which every view agrees best with the others."""
        offset_s = estimate_start_offsets(self.observations, model, self.scale, self._step_s, self._reach)
        for v, view_offset_s in enumerate(offset_s):
            model = model.with_offset(v, view_offset_s)
        return model

    def _reordered(self, model: RecordingModel, table: np.ndarray) -> CoarseCorrection | None:
        """Return the best other assignment of cameras to views, if any is better."""
        costs = self._assignment_costs(model)
        order = best_order(costs, model.cameras)
        if order == model.cameras:
            return None
        tried = model
        for v, camera in enumerate(order):
            if camera != model.cameras[v]:
                tried = tried.with_camera(self.observations, v, camera)
        moved = [v for v in range(len(order)) if order[v] != model.cameras[v]]
        after = self.table(tried)
        gain = CoarseCorrection(
            "order", -1, tried, *(float(np.nanmean([_level(t[v]) for v in moved])) for t in (table, after))
        )
        return gain if gain.before - gain.after > 2.0 * MIN_GAIN and gain.after < AGREES else None

    def _assignment_costs(self, model: RecordingModel) -> np.ndarray:
        """Return the disagreement of all pairs of views, each with any camera, shape (view, camera, view, camera)."""
        observations, views = self.observations, self.observations.n_views
        few = model.resampled(model.frames[:: max(1, len(model.frames) // 30)])
        seen = {}
        for v in range(views):
            for c in range(views):
                tried = few.with_camera(observations, v, c)
                seen[v, c] = posed_view(observations, tried, v, self.scale)
        costs = np.full((views,) * 4, np.nan)
        for a, b in combinations(range(views), 2):
            for c, d in permutations(range(views), 2):
                costs[a, c, b, d] = costs[b, d, a, c] = disagreement(seen[a, c], seen[b, d])
        return costs


def _view_levels(table: np.ndarray) -> np.ndarray:
    """Return the disagreement level of every view."""
    return np.array([_level(row) for row in table])


def _mean(table: np.ndarray) -> float:
    """Return the mean over all pairs; NaN if no pair shares enough points."""
    known = table[np.isfinite(table)]
    return float(known.mean()) if len(known) else np.nan


def _level(row: np.ndarray) -> float:
    """Return a view's mean disagreement with the others without the worst third, which may be faulty themselves."""
    known = np.sort(row[np.isfinite(row)])
    if not len(known):
        return np.nan
    return float(known[: max(1, -(-2 * len(known) // 3))].mean())
