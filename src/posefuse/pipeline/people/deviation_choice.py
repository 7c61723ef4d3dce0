"""Choose how far keypoints deviate from fitted bodies, by the prediction of left-out views."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from posefuse.model.cameras import Camera
from posefuse.pipeline.people.keypoint_deviations import deviating_points
from posefuse.skeleton.skeletons import Skeleton

_SHARES = (0.0, 0.002, 0.004, 0.008, 0.016, 0.032, 0.064, 0.128)
"""Standard deviations to choose from, as shares of the body size."""

_PIECES = 4
"""Number of parts of a sample whose errors count as independent: a part of about a quarter of a second."""

_MIN_BLOCKS, _MIN_ERRORS = 4, 20
"""Least evidence for a choice that differs from that of all keypoints together."""

_STANDARD_ERRORS = 2.0
"""Number of standard errors by which a choice must be better than another."""

_MAX_NAMED = 4


@dataclass(frozen=True, eq=False)
class LeftOutSample:
    """Points of some consecutive frames computed without a view, and what the view shows.

    Attributes:
        view: index of the view that is left out.
        camera: its camera.
        pixels: shape (frame, person, keypoint, 2), NaN without a detection.
        body_m: shape (frame, person, keypoint, 3): points of fitted bodies, NaN where missing.
        measured_m: shape (frame, person, keypoint, 3): measured points.
        covariance_m2: shape (frame, person, keypoint, 6): covariances of the measured points.
    """

    view: int
    camera: Camera
    pixels: np.ndarray
    body_m: np.ndarray
    measured_m: np.ndarray
    covariance_m2: np.ndarray

    def errors_px(self, sds_m: np.ndarray) -> np.ndarray:
        """Return the prediction errors, shape (choice, frame, person, keypoint), NaN without prediction or detection.

        Args:
            sds_m: shape (choice,): standard deviations of the deviations of all keypoints.
        """
        body = self.body_m, np.zeros_like(self.covariance_m2)
        errors = np.empty((len(sds_m), *self.pixels.shape[:-1]))
        for i, sd_m in enumerate(sds_m):
            everywhere = np.full(self.pixels.shape[2], sd_m)
            points, _ = deviating_points(body, (self.measured_m, self.covariance_m2), everywhere)
            errors[i] = np.linalg.norm(self.camera.project(points)[0] - self.pixels, axis=-1)
        return errors


def choices_m(skeleton: Skeleton) -> np.ndarray:
    """Return the standard deviations to choose from, shape (choice,); the first is 0."""
    assert skeleton.tree is not None
    return skeleton.tree.size_m * np.array(_SHARES)


def chosen_deviations(skeleton: Skeleton, errors: Sequence[tuple[int, np.ndarray]]) -> np.ndarray:
    """Return for each keypoint the index of the choice that predicts left-out views best, shape (keypoint,), int64.

    The keypoints of the body, and of each hand and face, have one choice together. It is preferred to rigid keypoints
    if the mean error decreases by more than two standard errors; the choice of a single keypoint, likewise, to the
    common one.

    Args:
        skeleton: skeleton of the keypoints.
        errors: view that was left out and prediction errors, shape (choice, frame, person, keypoint), of each sample.
    """
    chosen = np.zeros(len(skeleton), dtype=np.int64)
    if not errors:
        return chosen
    part_of = np.zeros(len(skeleton), dtype=np.int64)
    for i, part in enumerate(skeleton.parts, 1):
        part_of[part.keypoints] = i
    for i in np.unique(part_of):
        keypoints = np.flatnonzero(part_of == i)
        sums, counts, views = _block_sums(errors, keypoints)
        common = _better(sums, counts, views, 0)
        for j, keypoint in enumerate(keypoints):
            chosen[keypoint] = _better(sums[:, :, [j]], counts[:, [j]], views, common)
    return chosen


def describe_deviations(skeleton: Skeleton, sd_m: np.ndarray) -> str:
    """Return a sentence on the keypoints that deviate from the bodies; empty if all are rigid."""
    free = np.flatnonzero(sd_m > 0.0)
    if not len(free):
        return ""
    most = free[np.argsort(-sd_m[free], kind="stable")][:_MAX_NAMED]
    named = ", ".join(f"{skeleton.keypoints[k]} {1000.0 * sd_m[k]:.3g}" for k in most)
    verb = "deviates" if len(free) == 1 else "deviate"
    return (
        f"In the model layer, {len(free)} of {len(skeleton)} keypoints {verb} from the fitted bodies: points "
        f"with deviations predict left-out views better. The largest standard deviations in mm: {named}."
    )


def _block_sums(
    errors: Sequence[tuple[int, np.ndarray]], keypoints: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the errors of blocks of frames.

    Returns:
        Sums of errors, shape (choice, block, keypoint), their numbers, shape (block, keypoint), and the views that were
        left out, shape (block,), int64.
    """
    sums, counts, views = [], [], []
    for view, error in errors:
        own = error[..., keypoints]
        known = np.asarray(np.isfinite(own).all(axis=0))
        own = np.where(known, own, 0.0)
        for piece in np.array_split(np.arange(own.shape[1]), _PIECES):
            sums.append(own[:, piece].sum(axis=1))
            counts.append(known[piece].sum(axis=0))
            views.append(np.full(own.shape[2], view))
    return np.concatenate(sums, axis=1), np.concatenate(counts), np.concatenate(views)


def _better(sums: np.ndarray, counts: np.ndarray, views: np.ndarray, base: int) -> int:
    """Return the choice whose mean error is lower than that of ``base`` by most beyond its standard error.

    Args:
        sums: shape (choice, block, keypoint): sums of errors.
        counts: shape (block, keypoint): numbers of errors.
        views: shape (block,): views that were left out.
        base: index of the choice to compare with.
    """
    total = counts.sum()
    if np.count_nonzero(counts.any(axis=1)) < _MIN_BLOCKS or total < _MIN_ERRORS:
        return base
    difference = sums - sums[base]
    mean = difference.sum(axis=(1, 2)) / total
    excess = difference - mean[:, None, None] * counts
    # Errors of calibration and of detectors are common to all frames of a view; two keypoints are no body.
    by_block = excess.sum(axis=2)
    by_view = np.stack([by_block[:, views == view].sum(axis=1) for view in np.unique(views)], axis=1)
    error = np.max([_standard_error(each) for each in (by_block, by_view, excess.sum(axis=1))], axis=0)
    bound = mean + _STANDARD_ERRORS * error / total
    best = int(np.argmin(bound))
    return best if bound[best] < 0.0 else base


def _standard_error(excess: np.ndarray) -> np.ndarray:
    """Return the standard errors of sums over independent blocks, shape (choice,), from those of (choice, block)."""
    has = (excess != 0.0).any(axis=0)
    n = int(has.sum())
    return np.sqrt(np.square(excess).sum(axis=1) * n / max(n - 1, 1))
