"""What looks at a body have told of its lengths, apart from what is known of any body's."""

import numpy as np

from posefuse.skeleton.trees import Tree

_LEAST = 1e-6
"""Of all bodies' mean certainty: what rounding leaves where a look has told nothing."""


def told_of_lengths(tree: Tree, mean_m: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Take the prior off a posterior.

    Args:
        tree: whose law of lengths was the prior, N(tree.shape_m, tree.shape_covariance).
        mean_m: shape (shape,): afterwards.
        covariance: shape (shape, shape): afterwards.

    Returns:
        The information of the looks, shape (shape, shape), positive definite, and that times what they measured less
        ``tree.shape_m``, shape (shape,).
    """
    before, after = np.linalg.inv(tree.shape_covariance), np.linalg.inv(covariance)
    values, axes = np.linalg.eigh(after - 0.5 * (before + before.T))
    # Lengths wander a little, so that what a look has not told may be less than was known.
    values = np.maximum(values, _LEAST * np.trace(before) / len(before))
    return (axes * values) @ axes.T, after @ (mean_m - tree.shape_m)


def measured_lengths(tree: Tree, mean_m: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What looks measured, less ``tree.shape_m``, shape (shape,), and the covariance of its errors (shape, shape).

    Args:
        tree: as for :func:`told_of_lengths`.
        mean_m: likewise.
        covariance: likewise.
    """
    information, pull = told_of_lengths(tree, mean_m, covariance)
    errors = np.linalg.inv(information)
    return errors @ pull, 0.5 * (errors + errors.T)
