"""``posefuse overlay``."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from posefuse.cli.console import Bars, count, note, say, warn
from posefuse.cli.videos import Offsets, Videos
from posefuse.model.options.options import LayerName


def overlay(
    result: Annotated[Path, Parameter(help="A result's folder, or its reconstruction.nc.")],
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for the videos; made if absent.")],
    video: Videos = (),
    layer: Annotated[LayerName | None, Parameter(help="Which points; by default the best layer there is.")] = None,
    detections: Annotated[
        Path | None,
        Parameter(help="The recording's folder: what the detector saw is drawn too, and what became of it."),
    ] = None,
    grid: Annotated[bool, Parameter(help="All cameras side by side in one video.", negative="")] = False,
    blank: Annotated[bool, Parameter(help="Cameras without a video on a plain background.", negative="")] = False,
    start_s: Annotated[float | None, Parameter(help="Time in the result to begin at.")] = None,
    end_s: Annotated[float | None, Parameter(help="Time in the result to end before.")] = None,
    offset_s: Offsets = (),
    match: Annotated[
        Literal["time", "frame"], Parameter(help="Pictures belong to frames by time, or by their number from 0.")
    ] = "time",
    rescale: Annotated[
        bool, Parameter(help="Take a video of another size, but the same shape, for the whole image.", negative="")
    ] = False,
) -> None:
    """Draw a result's skeletons on the cameras' videos, through each lens.

    Writes <camera>_overlay.mp4 each, or overlay.mp4 with --grid. Faint: held or filled in, or the person is lost.
    """
    from posefuse.cli.videos import detections_in, layer_of, offsets_by_camera, videos_by_camera
    from posefuse.io.results.open_result import open_result
    from posefuse.visualize.overlay.options import OverlayOptions
    from posefuse.visualize.overlay.write import write_overlays

    _, opened = open_result(result)
    chosen = OverlayOptions(
        layer=layer_of(opened, layer),
        grid=grid,
        blank=blank,
        rescale=rescale,
        match=match,
        start_s=start_s,
        end_s=end_s,
        offset_s=offsets_by_camera(offset_s),
    )
    videos = videos_by_camera(opened.rig, video)
    sightings = detections_in(opened, detections)
    written = write_overlays(opened, videos, output, chosen, sightings, Bars())
    left_out = [name for name in opened.rig.names if name not in videos]
    if left_out and not blank:
        note(f"note: no video of {', '.join(left_out)}: not drawn (--blank draws them on a plain background).")
    for each in written:
        bare = each.n_images - each.n_drawn
        more = f", {bare} without a frame of the result" if bare else ""
        say(f"Wrote {each.path}: {count(each.n_images, 'picture')}{more}")
        for remark in each.remarks:
            warn(remark)
