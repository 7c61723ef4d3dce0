"""Videos for the viewer, checked as those that are drawn on."""

from collections.abc import Mapping
from pathlib import Path

from posefuse.io.videos.footage import as_mp4, content_of, is_played
from posefuse.io.videos.reading import picture_times_s
from posefuse.model.reconstruction import Reconstruction
from posefuse.visualize.clock import Clock
from posefuse.visualize.overlay.options import OverlayOptions
from posefuse.visualize.overlay.sources import open_sources
from posefuse.visualize.viewer.scene import Footage


def footage_of(result: Reconstruction, videos: Mapping[str, Path], options: OverlayOptions) -> dict[str, Footage]:
    """The cameras' videos as the viewer plays them: an mp4 as it is, any other encoded anew.

    Raises:
        MatchError: if a video or an offset names no camera.
        FileError: if a video cannot be read.
        ResultError: if a video has another size than its camera.
    """
    clock = Clock.of(result)
    middle_s = (clock.first_s + clock.end_s) / 2
    found = {}
    for source in open_sources(result.rig, videos, options, clock.timed, result.options.sync):
        if source.reading is None:
            continue
        facts = source.reading.facts
        content = content_of(facts.path) if is_played(facts) else as_mp4(facts.path)
        found[source.camera.name] = Footage(
            content,
            picture_times_s(facts.path),
            # The viewer knows one offset a video: that in the middle, if it drifts.
            source.true_s(middle_s) - middle_s,
            source.by_number,
            facts.first_s if is_played(facts) else 0.0,
        )
    return found
