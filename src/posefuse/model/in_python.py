"""Tables and figures of a result, for Python and notebooks. What they need is loaded on first use."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from posefuse.model.options.options import LayerName


class InPython:
    """Methods of a result that return objects of other libraries."""

    def to_xarray(self, layer: LayerName | None = None) -> Any:
        """Return a layer as an ``xarray.Dataset``; needs xarray.

        Args:
            layer: name of the layer; by default the best one.

        Returns:
            Variables ``position`` and ``sd`` (time, individual, keypoint, space) in m, ``status`` and
            ``reprojection_error`` (time, individual, keypoint) in px, and joint angles, where they exist:
            ``joint_angle`` and ``joint_angle_sd`` (time, individual, angle) in degrees.

        Raises:
            LayerError: if the layer does not exist.
            ResultError: if xarray is not installed.
        """
        return _loaded("posefuse.io.results.python_tables", "to_xarray")(self, layer)

    def to_dataframe(self, layer: LayerName | None = None) -> Any:
        """Return a layer as a ``pandas.DataFrame`` with a row per frame, subject and keypoint; needs pandas.

        Args:
            layer: name of the layer; by default the best one.

        Raises:
            LayerError: if the layer does not exist.
            ResultError: if pandas is not installed.
        """
        return _loaded("posefuse.io.results.python_tables", "to_dataframe")(self, layer)

    def plot(self, figure: str = "trajectories", layer: LayerName | None = None) -> Any:
        """Return a matplotlib figure of the result.

        Args:
            figure: one of the figures of ``posefuse plot``: errors, shares, time, trajectories, angles, gait and more.
            layer: name of the layer; by default the best one.

        Raises:
            OptionsError: if there is no such figure, or the result has no data for it.
        """
        return _loaded("posefuse.pipeline.notebook", "plot_result")(self, figure, layer)

    def view(self, height_px: int = 720) -> Any:
        """Return the interactive report, with its 3D scene, for display in a notebook.

        Args:
            height_px: height of the frame.
        """
        return _loaded("posefuse.pipeline.notebook", "view_result")(self, height_px)


def _loaded(module: str, name: str) -> Callable[..., Any]:
    """Return a function of a module that is loaded on first use: results depend neither on formats nor on figures."""
    return getattr(import_module(module), name)
