"""A board model whose shape is estimated, too: all views share its parameters."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.boards.model import BoardModel
from posefuse.calibration.boards.observations import CornerObservations
from posefuse.calibration.boards.parameters import N_PARAMETERS
from posefuse.calibration.boards.shape import N_SHAPE, shape_directions, shape_precision
from posefuse.calibration.normal_equations import Prior, ResidualRows


@dataclass(frozen=True, eq=False)
class ShapedModel:
    """Cameras, poses of a board, and its shape, as the model of a bundle adjustment.

    The parameters of the shape follow those of each camera: ``change`` and the rows have 24 instead of 19 columns.

    Attributes:
        board: cameras and poses of the board.
    """

    board: BoardModel

    @property
    def observations(self) -> CornerObservations:
        """Observations of the corners."""
        return self.board.observations

    @property
    def n_views(self) -> int:
        """Number of cameras."""
        return self.board.n_views

    def rows(self, scale: np.ndarray) -> ResidualRows:
        """Return residuals and derivatives at noise factors of shape (view,)."""
        rows, seen = self.board.rows(scale), self.observations
        # The derivative by the origin of the board is that by the place of the corner.
        by_corner = rows.by_point[:, :, 3:] @ self.board.image_rotations()
        by_shape = by_corner @ shape_directions(self.board.board)[seen.corner]
        wide = np.concatenate([rows.by_camera, by_shape], axis=2)
        return replace(rows, by_camera=wide, prior=self._prior(rows.prior), n_shared=N_SHAPE)

    def _prior(self, lenses: Prior | None) -> Prior:
        """Return the prior of the lenses and, in the first view, of the shape."""
        n, size = self.n_views, N_PARAMETERS + N_SHAPE
        precision = shape_precision(self.board.board)
        cost = 0.5 * float((precision * self.board.shape**2).sum()) + (0.0 if lenses is None else lenses.cost)
        out = Prior(np.zeros((n, size)), np.zeros((n, size, size)), cost)
        if lenses is not None:
            out.gradient[:, :N_PARAMETERS] = lenses.gradient
            out.matrices[:, :N_PARAMETERS, :N_PARAMETERS] = lenses.matrices
        at = np.arange(N_PARAMETERS, size)
        out.matrices[0, at, at] = precision
        out.gradient[0, at] = precision * self.board.shape
        return out

    def moved(self, change: np.ndarray, step: np.ndarray) -> "ShapedModel":
        """Return the model after changes of the cameras and the shape (view, 24), and of the poses (pose, 6)."""
        board = self.board.moved(change[:, :N_PARAMETERS], step)
        return ShapedModel(replace(board, shape=board.shape + change[0, N_PARAMETERS:]))


def with_free_shape(free: np.ndarray) -> np.ndarray:
    """Return which parameters are free if the shape is, shape (view, 24), from those of the cameras (view, 19)."""
    return np.concatenate([free, np.ones((len(free), N_SHAPE), dtype=bool)], axis=1)
