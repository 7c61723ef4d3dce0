"""Lengths of bodies that somebody measured: the law of how bodies differ, given that."""

from dataclasses import replace

import numpy as np

from posefuse.arrays import frozen
from posefuse.errors import OptionsError, suggestion
from posefuse.model.options.tracker import TrackerOptions
from posefuse.skeleton.skeletons import Skeleton
from posefuse.skeleton.trees import Tree

_STATURE_SD = 0.03
"""By how much of their sum the lengths of bodies of one stature differ."""


def with_known_lengths(skeleton: Skeleton, options: TrackerOptions) -> Skeleton:
    """The skeleton whose bodies are as long as the options say: a Gaussian law of lengths, conditioned on them.

    Args:
        skeleton: with a tree; returned as it is where nothing is known.
        options: of the tracker: ``stature_m``, ``known_m`` and ``known_sd_m``.

    Raises:
        OptionsError: if the tree has no length of a name.
    """
    tree = skeleton.tree
    if tree is None or (options.stature_m is None and not options.known_m):
        return skeleton
    rows, values, sds = [], [], []
    if options.stature_m is not None:
        rows.append(np.ones(tree.n_shape))
        values.append(tree.shape_m.sum() * options.stature_m / tree.size_m)
        sds.append(_STATURE_SD * values[-1])
    for name, length_m in options.known_lengths_m.items():
        rows.append(np.arange(tree.n_shape) == _place(tree, name, skeleton.name))
        values.append(length_m)
        sds.append(options.known_sd_m)
    told = np.array(rows, dtype=np.float64)
    return replace(skeleton, tree=_conditioned(tree, told, np.array(values), np.array(sds)))


def _place(tree: Tree, name: str, skeleton: str) -> int:
    """The number of a length; both sides have one."""
    plain = name.replace("right_", "left_", 1) if name.startswith("right_") else name
    if plain not in tree.shape_names:
        raise OptionsError(
            f"tracker.known_m: bodies of skeleton {skeleton!r} have no length {name!r}. "
            f"{suggestion(plain, tree.shape_names)}"
        )
    return tree.shape_names.index(plain)


def _conditioned(tree: Tree, told: np.ndarray, values: np.ndarray, sds: np.ndarray) -> Tree:
    """The tree whose lengths have been told: ``told`` (row, shape) times them is ``values``, with errors ``sds``."""
    prior = tree.shape_covariance
    spread = told @ prior @ told.T + np.diag(sds**2)
    gain = np.linalg.solve(spread, told @ prior).T
    left = np.eye(tree.n_shape) - gain @ told
    after = left @ prior @ left.T + (gain * sds**2) @ gain.T
    mean = tree.shape_m + gain @ (values - told @ tree.shape_m)
    return replace(tree, shape_m=frozen(mean), shape_covariance=frozen(0.5 * (after + after.T)))
