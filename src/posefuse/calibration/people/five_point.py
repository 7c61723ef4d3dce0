"""Essential matrices from five corresponding rays.

H. Stewenius, C. Engels and D. Nister, "Recent developments on direct relative orientation", ISPRS Journal 60, 2006: the
ten cubic constraints of an essential matrix within the null space of five correspondences, solved by the eigenvectors
of an action matrix. All samples are solved at once.
"""

from itertools import combinations_with_replacement, permutations

import numpy as np

_IMAGINARY = 1e-6


def essential_matrices(rays_a: np.ndarray, rays_b: np.ndarray) -> np.ndarray:
    """Return the essential matrices of samples, ``b^T E a = 0``, of unit norm.

    Args:
        rays_a: shape (sample, 5, 3): rays of the first view.
        rays_b: shape (sample, 5, 3): rays of the second view.

    Returns:
        Shape (solution, 3, 3): up to ten real solutions of each sample.
    """
    rows = np.einsum("nki,nkj->nkij", rays_b, rays_a).reshape(-1, 5, 9)
    # The null space is the orthogonal complement of the rows.
    basis = np.linalg.qr(rows.transpose(0, 2, 1), mode="complete")[0][:, :, 5:]
    basis = basis.transpose(0, 2, 1).reshape(-1, 4, 3, 3)
    constraints = _constraints(basis)
    left, right = constraints[:, :, :10], constraints[:, :, 10:]
    usable = np.abs(np.linalg.det(left)) > 1e-300
    basis = basis[usable]
    eliminated = np.linalg.solve(left[usable], right[usable])
    action = np.zeros_like(eliminated)
    action[:, :6] = -eliminated[:, _TIMES_X[:6]]
    action[:, np.arange(6, 10), _TIMES_X[6:]] = 1.0
    values, vectors = np.linalg.eig(action)
    real = np.abs(np.imag(values)) < _IMAGINARY * (1.0 + np.abs(np.real(values)))
    sample, column = np.nonzero(real)
    monomials = np.real(vectors)[sample, :, column]
    found = np.einsum("nk,nkij->nij", monomials[:, 6:10], basis[sample])
    size = np.linalg.norm(found, axis=(1, 2), keepdims=True)
    keep = (size[:, 0, 0] > 0.0) & np.isfinite(size[:, 0, 0])
    return np.ascontiguousarray(found[keep] / size[keep])


def decompose(essential: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the two rotations, shape (..., 2, 3, 3), and the unit translation up to its sign, shape (..., 3)."""
    left, _, right = np.linalg.svd(essential)
    left = left * np.linalg.det(left)[..., None, None]
    right = right * np.linalg.det(right)[..., None, None]
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return np.stack([left @ turn @ right, left @ turn.T @ right], axis=-3), left[..., 2]


def _constraints(basis: np.ndarray) -> np.ndarray:
    """Return the coefficients of the ten constraints, shape (sample, 10, 20 monomials)."""
    n = len(basis)
    squares = np.einsum("naij,nbkj->nabik", basis, basis)
    trace = np.einsum("nabii->nab", squares)
    cubic = 2.0 * np.einsum("nabik,nckj->nabcij", squares, basis) - np.einsum("nab,ncij->nabcij", trace, basis)
    minors = np.einsum("naij,nbkl,ikp,jlq->nabpq", basis, basis, _LEVI_CIVITA, _LEVI_CIVITA, optimize=True)
    determinant = np.einsum("nabpq,ncpq->nabc", minors, basis)
    terms = np.concatenate([cubic.reshape(n, 64, 9), determinant.reshape(n, 64, 1)], axis=2)
    return np.einsum("nkc,km->ncm", terms, _FOLD)


def _levi_civita() -> np.ndarray:
    out = np.zeros((3, 3, 3))
    for order in permutations(range(3)):
        out[order] = np.linalg.det(np.eye(3)[list(order)])
    return out


def _monomials() -> tuple[list[tuple[int, ...]], np.ndarray]:
    """Return the cubic monomials of (x, y, z, 1), those of degree three first, and the table that folds products."""
    # Index 3 is the constant: fewer of it is a higher degree.
    order: list[tuple[int, ...]] = sorted(combinations_with_replacement(range(4), 3), key=lambda m: (m.count(3), m))
    fold = np.zeros((4, 4, 4, 20))
    for a in range(4):
        for b in range(4):
            for c in range(4):
                fold[a, b, c, order.index(tuple(sorted((a, b, c))))] = 1.0
    return order, fold.reshape(64, 20)


_LEVI_CIVITA = _levi_civita()
_ORDER, _FOLD = _monomials()


def _times_x() -> np.ndarray:
    """Return, for each of the last ten monomials, the place of its product with x.

    The first six products are of degree three: a row of the eliminated system. The others are of the last ten.
    """
    products = [tuple(sorted((0, *monomial[:2]))) for monomial in _ORDER[10:]]
    places = [_ORDER.index(product) for product in products]
    return np.array([place if place < 10 else place - 10 for place in places])


_TIMES_X = _times_x()
