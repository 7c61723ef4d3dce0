"""``posefuse view``."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from posefuse.cli.console import Bars, note, say
from posefuse.cli.types import Overwrite, Result
from posefuse.cli.videos import Offsets, Videos
from posefuse.model.reconstruction import Reconstruction

if TYPE_CHECKING:
    from posefuse.visualize.viewer.scene import ViewerVideo


@dataclass(frozen=True)
class _Times:
    """Flags of the part that is shown, and of its images."""

    match: Annotated[
        Literal["time", "frame"], Parameter(help="Match images to frames by time, or by number from 0.")
    ] = "time"
    start_s: Annotated[float | None, Parameter(help="Start time, in the result's time.")] = None
    end_s: Annotated[float | None, Parameter(help="End time, exclusive, in the result's time.")] = None


@dataclass(frozen=True)
class _Saving:
    """Flags of the file that replaces the window."""

    save: Annotated[Path | None, Parameter(help="Write a .rrd file instead of opening a window.")] = None
    overwrite: Overwrite = False


def view(
    result: Result,
    *,
    recording: Annotated[Path | None, Parameter(help="Folder of the recording, to show its detections.")] = None,
    keypoints: Annotated[
        Path | None,
        Parameter(help="File or folder of 2D keypoints to show; by default those in the recording."),
    ] = None,
    video: Videos = (),
    offset_s: Offsets = (),
    times: Annotated[_Times, Parameter(name="*")] = _Times(),
    saving: Annotated[_Saving, Parameter(name="*")] = _Saving(),
) -> None:
    """Open a result in the rerun viewer: people in 3D, camera images, and numbers over time.

    Requires pip install 'posefuse[view]'.
    """
    from posefuse.cli.videos import detections_in
    from posefuse.io.files import replacing
    from posefuse.io.outputs import check_new_files
    from posefuse.io.results.open_result import open_result
    from posefuse.visualize.frame_times import frames_between
    from posefuse.visualize.viewer.library import import_rerun
    from posefuse.visualize.viewer.show import open_scene, require_display, save_scene

    import_rerun()
    save = saving.save
    if save is None:
        require_display()
    else:
        check_new_files([save], overwrite=saving.overwrite, target="--save")
    _, whole = open_result(result)
    opened = frames_between(whole, times.start_s, times.end_s)
    videos = _viewer_videos(opened, video, offset_s, times.match)
    detections = detections_in(opened, recording, keypoints)
    if save is None:
        open_scene(opened, detections, videos, Bars())
        return
    with replacing(save) as temporary:
        save_scene(opened, temporary, detections, videos, Bars())
    say(f"Wrote {save}")
    note(f"Open it with: rerun {save}")


def _viewer_videos(
    result: Reconstruction, video: tuple[str, ...], offset_s: tuple[str, ...], match: Literal["time", "frame"]
) -> Mapping[str, "ViewerVideo"]:
    from posefuse.cli.videos import offsets_by_camera, videos_by_camera
    from posefuse.visualize.overlay.options import OverlayOptions
    from posefuse.visualize.viewer.videos import load_viewer_videos

    videos = videos_by_camera(result.rig, video)
    options = OverlayOptions(match=match, offset_s=offsets_by_camera(offset_s), blank=not videos)
    return load_viewer_videos(result, videos, options)
