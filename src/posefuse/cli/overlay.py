"""``posefuse overlay``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from posefuse.cli.console import Bars, count, note, say, warn
from posefuse.cli.types import Overwrite, Result
from posefuse.cli.videos import Offsets, Videos
from posefuse.model.options.options import LayerName


@dataclass(frozen=True)
class _Drawing:
    """Flags of what is drawn and how."""

    layer: Annotated[LayerName | None, Parameter(help="Layer to draw; by default the best one available.")] = None
    grid: Annotated[bool, Parameter(help="Show all cameras side by side in one video.", negative="")] = False
    blank: Annotated[bool, Parameter(help="Draw cameras without a video on a plain background.", negative="")] = False
    start_s: Annotated[float | None, Parameter(help="Start time, in the result's time.")] = None
    end_s: Annotated[float | None, Parameter(help="End time, exclusive, in the result's time.")] = None
    match: Annotated[
        Literal["time", "frame"], Parameter(help="Match images to frames by time, or by number from 0.")
    ] = "time"
    rescale: Annotated[bool, Parameter(help="Accept a scaled video with the same aspect ratio.", negative="")] = False


def overlay(
    result: Result,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"], help="Folder for the videos.")],
    video: Videos = (),
    offset_s: Offsets = (),
    detections: Annotated[
        Path | None,
        Parameter(help="Folder of the recording, to draw the detections and whether they were used."),
    ] = None,
    keypoints: Annotated[
        Path | None,
        Parameter(help="File or folder of 2D keypoints to draw; by default those in the recording."),
    ] = None,
    overwrite: Overwrite = False,
    drawing: Annotated[_Drawing, Parameter(name="*", group="Drawing")] = _Drawing(),
) -> None:
    """Draw a result's skeletons on the cameras' videos, with lens distortion.

    Writes <camera>_overlay.mp4 per camera, or overlay.mp4 with --grid. Faint points are held, filled or lost.
    """
    from posefuse.cli.videos import detections_in, layer_of, offsets_by_camera, videos_by_camera
    from posefuse.io.results.open_result import open_result
    from posefuse.visualize.overlay.options import OverlayOptions
    from posefuse.visualize.overlay.write import write_overlays

    _, opened = open_result(result)
    chosen = OverlayOptions(
        layer=layer_of(opened, drawing.layer),
        grid=drawing.grid,
        blank=drawing.blank,
        rescale=drawing.rescale,
        match=drawing.match,
        start_s=drawing.start_s,
        end_s=drawing.end_s,
        offset_s=offsets_by_camera(offset_s),
    )
    videos = videos_by_camera(opened.rig, video)
    drawn_detections = detections_in(opened, detections, keypoints)
    written = write_overlays(opened, videos, output, chosen, drawn_detections, overwrite=overwrite, progress=Bars())
    left_out = [name for name in opened.rig.names if name not in videos]
    if left_out and not drawing.blank:
        note(
            f"note: there is no video of {', '.join(left_out)}; --blank draws cameras without a video on a plain "
            "background."
        )
    for each in written:
        n_without = each.n_images - each.n_drawn
        more = f", {n_without} without a frame of the result" if n_without else ""
        say(f"Wrote {each.path}: {count(each.n_images, 'image')}{more}")
        for text in each.notes:
            warn(text)
