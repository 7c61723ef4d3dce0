"""Information of observations about bone lengths, without the prior of all bodies."""

import numpy as np

from posefuse.skeleton.trees import Tree

_MIN_SHARE = 1e-6
"""Smallest information, as a share of the prior's mean information, which rounding leaves without an observation."""


def length_information(tree: Tree, mean_m: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the information left in a posterior after its prior is removed.

    Args:
        tree: Tree whose distribution of lengths was the prior, N(tree.shape_m, tree.shape_covariance).
        mean_m: shape (shape,): mean of the posterior.
        covariance: shape (shape, shape): covariance of the posterior.

    Returns:
        Information matrix of the observations, shape (shape, shape), positive definite; and its product with the
        measured lengths minus ``tree.shape_m``, shape (shape,).
    """
    before, after = np.linalg.inv(tree.shape_covariance), np.linalg.inv(covariance)
    values, axes = np.linalg.eigh(after - 0.5 * (before + before.T))
    # Lengths drift in the motion model, so unobserved directions may hold less information than the prior.
    values = np.maximum(values, _MIN_SHARE * np.trace(before) / len(before))
    return (axes * values) @ axes.T, after @ (mean_m - tree.shape_m)


def measured_lengths(tree: Tree, mean_m: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the measured lengths minus ``tree.shape_m``, shape (shape,), and the covariance of their errors.

    Args:
        tree: As for :func:`length_information`.
        mean_m: As for :func:`length_information`.
        covariance: As for :func:`length_information`.
    """
    information, pull = length_information(tree, mean_m, covariance)
    errors = np.linalg.inv(information)
    return errors @ pull, 0.5 * (errors + errors.T)
