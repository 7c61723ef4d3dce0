"""Videos of the cameras for the viewer."""

from collections.abc import Mapping
from pathlib import Path

from posefuse.io.videos.frame_index import read_frame_index
from posefuse.io.videos.mp4 import is_playable, read_content, transcode_to_mp4
from posefuse.model.reconstruction import Reconstruction
from posefuse.visualize.frame_times import FrameTimes
from posefuse.visualize.overlay.options import OverlayOptions
from posefuse.visualize.overlay.video_sources import open_sources
from posefuse.visualize.viewer.scene import ViewerVideo


def load_viewer_videos(
    result: Reconstruction, videos: Mapping[str, Path], options: OverlayOptions
) -> dict[str, ViewerVideo]:
    """Load the cameras' videos for the viewer: playable MP4 files unchanged, others transcoded.

    Raises:
        MatchError: if a video or an offset names an unknown camera.
        FileError: if a video cannot be read.
        ResultError: if the size of a video differs from its camera's.
    """
    frame_times = FrameTimes.of(result)
    middle_s = (frame_times.first_s + frame_times.end_s) / 2
    loaded = {}
    for source in open_sources(result.rig, videos, options, frame_times.timed, result.options.sync):
        if source.reader is None:
            continue
        info = source.reader.info
        content = read_content(info.path) if is_playable(info) else transcode_to_mp4(info.path)
        loaded[source.camera.name] = ViewerVideo(
            content,
            read_frame_index(info.path).time_s,
            # The viewer has one offset per video; with clock drift, use that of the middle of the result.
            source.synchronized_s(middle_s) - middle_s,
            source.by_number,
            info.first_s if is_playable(info) else 0.0,
        )
    return loaded
