"""Layout of the viewer's window: world, cameras, time series."""

from typing import Any

from posefuse.model.reconstruction import LAYERS, Reconstruction
from posefuse.visualize.viewer.library import import_rerun
from posefuse.visualize.viewer.scene import person_path

_SERIES = (("error_px", "reprojection error, px"), ("views", "views used"), ("speed_m_s", "speed, m/s"))


def build_layout(result: Reconstruction) -> Any:
    """Return rerun's blueprint. The best layer is visible; the others can be switched on."""
    rr = import_rerun()
    rrb = rr.blueprint
    best, _ = result.best_layer(result.options.layer)
    hidden = [name for name in LAYERS if name in result.layers and name != best]
    excluded_2d = [
        f"- world/cameras/{person_path(name)}/{kind}/**"
        for name in result.rig.names
        for kind in ("detected", "reprojected")
    ]
    world = rrb.Spatial3DView(
        origin="world",
        name="world",
        contents=["+ world/**", *excluded_2d],
        overrides={f"world/people/{name}": [rrb.EntityBehavior(visible=False)] for name in hidden},
    )
    cameras = [_camera_view(rrb, name) for name in result.rig.names]
    series = [rrb.TimeSeriesView(origin=f"series/{path}", name=name) for path, name in _SERIES]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(world, rrb.Grid(*cameras, name="cameras"), column_shares=[1, 1]),
            rrb.Horizontal(*series),
            row_shares=[3, 1],
        ),
        rrb.TimePanel(timeline="frame", fps=result.rate_hz or 30.0),
        collapse_panels=True,
        auto_views=False,
    )


def _camera_view(rrb: Any, name: str) -> Any:
    return rrb.Spatial2DView(origin=f"world/cameras/{person_path(name)}", name=name, contents="$origin/**")
