"""Condition the distribution of bone lengths on measured lengths."""

from dataclasses import replace

import numpy as np

from posefuse.arrays import frozen
from posefuse.errors import OptionsError, suggestion
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import Tree

_STATURE_SD_SHARE = 0.03
"""Standard deviation of the sum of all lengths for a given stature, as a share of the sum."""


def with_known_lengths(skeleton: Skeleton, options: TrackerOptions) -> Skeleton:
    """Return the skeleton with its Gaussian distribution of lengths conditioned on the known lengths.

    Args:
        skeleton: Skeleton with a tree; returned unchanged if no length is known.
        options: Options of the tracker: ``stature_m``, ``known_m`` and ``known_sd_m``.

    Raises:
        OptionsError: If the tree has no length of a given name.
    """
    tree = skeleton.tree
    if tree is None or (options.stature_m is None and not options.known_m):
        return skeleton
    rows, values, sds = [], [], []
    if options.stature_m is not None:
        rows.append(np.ones(tree.n_shape))
        values.append(tree.shape_m.sum() * options.stature_m / tree.size_m)
        sds.append(_STATURE_SD_SHARE * values[-1])
    for name, length_m in options.known_lengths_m.items():
        rows.append(np.arange(tree.n_shape) == _place(tree, name, skeleton.name))
        values.append(length_m)
        sds.append(options.known_sd_m)
    design = np.array(rows, dtype=np.float64)
    return replace(skeleton, tree=_conditioned(tree, design, np.array(values), np.array(sds)))


def _place(tree: Tree, name: str, skeleton: str) -> int:
    """Return the index of a length, which both sides share."""
    plain = name.replace("right_", "left_", 1) if name.startswith("right_") else name
    if plain not in tree.shape_names:
        raise OptionsError(
            f"tracker.known_m: bodies of skeleton {skeleton!r} have no length {name!r}. "
            f"{suggestion(plain, tree.shape_names)}"
        )
    return tree.shape_names.index(plain)


def _conditioned(tree: Tree, design: np.ndarray, values: np.ndarray, sds: np.ndarray) -> Tree:
    """Return the tree given ``design`` (row, shape) times the lengths, ``values``, with standard deviations ``sds``."""
    prior = tree.shape_covariance
    spread = design @ prior @ design.T + np.diag(sds**2)
    gain = np.linalg.solve(spread, design @ prior).T
    left = np.eye(tree.n_shape) - gain @ design
    after = left @ prior @ left.T + (gain * sds**2) @ gain.T
    mean = tree.shape_m + gain @ (values - design @ tree.shape_m)
    return replace(tree, shape_m=frozen(mean), shape_covariance=frozen(0.5 * (after + after.T)))
