"""``posefuse view``."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from posefuse.cli.console import Bars, note, say
from posefuse.cli.videos import Offsets, Videos
from posefuse.model.reconstruction import Reconstruction

if TYPE_CHECKING:
    from posefuse.visualize.viewer.scene import Footage


def view(
    result: Annotated[Path, Parameter(help="A result's folder, or its reconstruction.nc.")],
    *,
    recording: Annotated[
        Path | None, Parameter(help="The recording's folder: what the detector saw is shown too.")
    ] = None,
    video: Videos = (),
    offset_s: Offsets = (),
    match: Annotated[
        Literal["time", "frame"], Parameter(help="Pictures belong to frames by time, or by their number from 0.")
    ] = "time",
    start_s: Annotated[float | None, Parameter(help="Time in the result to begin at.")] = None,
    end_s: Annotated[float | None, Parameter(help="Time in the result to end before.")] = None,
    save: Annotated[
        Path | None, Parameter(help="Write a .rrd file instead of opening a window; rerun FILE opens it.")
    ] = None,
) -> None:
    """Look at a result in rerun's viewer: people in 3D, each camera's picture, numbers over time.

    Needs pip install 'posefuse[view]'.
    """
    from posefuse.cli.videos import detections_in
    from posefuse.io.files import replacing
    from posefuse.io.results.open_result import open_result
    from posefuse.visualize.clock import frames_between
    from posefuse.visualize.viewer.library import rerun
    from posefuse.visualize.viewer.show import must_have_display, open_scene, save_scene

    rerun()
    if save is None:
        must_have_display()
    _, whole = open_result(result)
    opened = frames_between(whole, start_s, end_s)
    footage = _footage(opened, video, offset_s, match)
    detections = detections_in(opened, recording)
    if save is None:
        open_scene(opened, detections, footage, Bars())
        return
    with replacing(save) as temporary:
        save_scene(opened, temporary, detections, footage, Bars())
    say(f"Wrote {save}")
    note(f"Open it with: rerun {save}")


def _footage(
    result: Reconstruction, video: tuple[str, ...], offset_s: tuple[str, ...], match: Literal["time", "frame"]
) -> Mapping[str, "Footage"]:
    from posefuse.cli.videos import offsets_by_camera, videos_by_camera
    from posefuse.visualize.overlay.footage import footage_of
    from posefuse.visualize.overlay.options import OverlayOptions

    videos = videos_by_camera(result.rig, video)
    options = OverlayOptions(match=match, offset_s=offsets_by_camera(offset_s), blank=not videos)
    return footage_of(result, videos, options)
