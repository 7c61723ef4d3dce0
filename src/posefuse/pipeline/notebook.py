"""Figures and the interactive report of a result in a notebook."""

from dataclasses import dataclass
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from posefuse.errors import OptionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.gait import analyze_gait


@dataclass(frozen=True)
class Page:
    """A page that a notebook shows in a frame.

    Attributes:
        html: the page.
        height_px: height of the frame.
    """

    html: str
    height_px: int

    def __repr__(self) -> str:
        return f"Page: {len(self.html) / 1e6:.1f} MB of HTML"

    def _repr_html_(self) -> str:
        style = f"width:100%;height:{self.height_px}px;border:0"
        return f'<iframe title="posefuse report" style="{style}" srcdoc="{escape(self.html, quote=True)}"></iframe>'


def view_result(result: Reconstruction, height_px: int) -> Page:
    """Return the interactive report; see :meth:`posefuse.Reconstruction.view`."""
    from posefuse.pipeline.report_videos import write_report

    with TemporaryDirectory() as folder:
        path = Path(folder) / "report.html"
        write_report(result, path)
        return Page(path.read_text("utf-8"), height_px)


def plot_result(result: Reconstruction, figure: str, layer: LayerName | None) -> Any:
    """Return a figure of a result; see :meth:`posefuse.Reconstruction.plot`."""
    from posefuse.report.plots.data import gather_plot_data
    from posefuse.report.plots.registry import find_plot

    plot = find_plot(figure)
    gait = analyze_gait(result) if figure == "gait" else None
    data = gather_plot_data(result, layer, (), (), None if gait is None else gait.people)
    draw = plot.load()(data)
    if draw is None:
        raise OptionsError(f"This result has no data for the figure {figure!r}, which requires {plot.requires}.")
    return draw()


def plot_rig(rig: CameraRig) -> Any:
    """Return a figure of the cameras; see :meth:`posefuse.CameraRig.plot`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 5.0), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d")
    centers = np.stack([camera.center_m for camera in rig.cameras])
    size = 0.12 * max(float(np.ptp(centers, axis=0).max()), 0.5)
    for camera in rig.cameras:
        corners = _frustum(camera.matrix, camera.size_px, size) @ camera.rotation + camera.center_m
        for corner in corners:
            axes.plot(*np.stack([camera.center_m, corner]).T, color="tab:blue", linewidth=0.8)
        axes.plot(*corners[[0, 1, 2, 3, 0]].T, color="tab:blue", linewidth=0.8)
        axes.text(*camera.center_m, camera.name, parse_math=False)
    axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)", title=f"{len(rig)} cameras")
    axes.set_aspect("equal")
    return figure


def _frustum(matrix: np.ndarray, size_px: tuple[int, int], depth_m: float) -> np.ndarray:
    """Return the corners of an image at a depth, in the camera's axes, shape (4, 3)."""
    width, height = size_px
    corners = np.array([[0.0, 0.0, 1.0], [width, 0.0, 1.0], [width, height, 1.0], [0.0, height, 1.0]])
    return depth_m * corners @ np.linalg.inv(matrix).T
