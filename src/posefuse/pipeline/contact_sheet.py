"""The contact sheet of a result: pictures of every person from the videos."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from posefuse.arguments import checked
from posefuse.errors import ResultError
from posefuse.io.files import replacing
from posefuse.io.outputs import check_new_page
from posefuse.io.videos.reader import open_video
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.tracks import TrackState
from posefuse.progress import Progress, Silent
from posefuse.report.contact_sheet import PersonCard, PersonPicture, render_contact_sheet
from posefuse.report.people import PersonSummary, summarize_people
from posefuse.visualize.annotations import Annotator
from posefuse.visualize.colors import BACKGROUND
from posefuse.visualize.drawing import DrawingStyle, draw
from posefuse.visualize.frame_times import FrameTimes
from posefuse.visualize.overlay.video_sources import VideoCursor, VideoSource, check_names, shown_area_px
from posefuse.visualize.person_pictures import Moment, best_moments, cut_out
from posefuse.visualize.pillow_extra import require_pillow

PICTURES = 3
"""Largest number of pictures of a person, each of another camera."""


@checked
def write_contact_sheet(
    result: Reconstruction,
    path: Path,
    *,
    videos: Mapping[str, Path] | None = None,
    offset_s: Mapping[str, float] | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> None:
    """Write a page with pictures of every person and the name that ``Options(person=...)`` takes.

    The pictures show the person whole, large and alone, with the skeleton. Without videos, they show the skeleton only.

    Args:
        result: the result.
        path: the HTML file.
        videos: video of each camera, by name; with any, cameras without one have no picture.
        offset_s: start of each camera's video in the result's time; 0 by default.
        overwrite: whether to replace an existing page.
        progress: receives the progress.

    Raises:
        MatchError: if a video or an offset names an unknown camera.
        FileError: if a video cannot be read, or the name of the page does not end in .html.
        ResultError: if the result is of a single camera, its people differ from frame to frame, or Pillow or
            matplotlib is not installed.
        OutputExistsError: if the page exists and ``overwrite`` is False.
    """
    progress, videos, offset_s = progress or Silent(), videos or {}, offset_s or {}
    if not result.has_identities:
        raise ResultError("The people of unrelated frames have no identity, so there is none to select.")
    check_new_page(path, overwrite=overwrite)
    require_pillow()
    check_names(result.rig, videos, "videos")
    check_names(result.rig, offset_s, "offset_s")
    layer, _ = result.best_layer(result.options.layer)
    annotator, frame_times = Annotator(result, layer), FrameTimes.of(result)
    sources, notes = _sources(result, videos, offset_s, frame_times)
    shown = [source.view for source in sources if source.reader is not None or not videos]
    people = best_moments(result, layer, shown, PICTURES)
    progress.start("taking pictures", sum(len(moments) for moments in people))
    cards = []
    for name, presence, moments in zip(result.person_ids, _presences(result, layer), people, strict=True):
        pictures = []
        for moment in moments:
            pictures.append(_picture(annotator, sources[moment.view], frame_times, moment))
            progress.advance(1)
        cards.append(PersonCard(name, presence, tuple(picture for picture in pictures if picture is not None)))
    progress.finish()
    text = render_contact_sheet(cards, notes)
    with replacing(path) as temporary:
        temporary.write_text(text, "utf-8")


def _sources(
    result: Reconstruction, videos: Mapping[str, Path], offset_s: Mapping[str, float], frame_times: FrameTimes
) -> tuple[list[VideoSource], list[str]]:
    """Return the images of every camera, and notes on videos that do not fit; without a reader they are plain."""
    notes = [] if videos else ["Without videos, the pictures show the skeletons only."]
    sources = []
    for view, camera in enumerate(result.rig.cameras):
        reader = open_video(videos[camera.name]) if camera.name in videos else None
        if reader is not None:
            try:
                shown_area_px(camera, reader.info)
            except ResultError as error:
                notes.append(f"The video of {camera.name} is not shown: {error}")
                reader = None
        shift_s = offset_s.get(camera.name, 0.0)
        sources.append(VideoSource(camera, view, reader, shift_s, not frame_times.timed, result.options.sync))
    return sources, notes


def _presences(result: Reconstruction, layer: LayerName) -> list[str]:
    """Return in words when each person is there."""
    people = summarize_people(result.windows(), layer)
    if not people:
        return ["In the whole recording."] * len(result.person_ids)
    return [_presence(result, person) for person in people]


def _presence(result: Reconstruction, person: PersonSummary) -> str:
    if person.first < 0:
        return "In no frame."
    share = person.frames[TrackState.ACTIVE] / max(result.n_frames, 1)
    times = result.time_s[[person.first, person.last]]
    if np.isfinite(times).all():
        span = f"{times[0]:.1f} to {times[1]:.1f} s"
    else:
        span = f"frames {result.frame_numbers[person.first]} to {result.frame_numbers[person.last]}"
    return f"{span}, active in {share:.0%} of the frames, detected by {person.n_views:.1f} cameras on average"


def _picture(
    annotator: Annotator, source: VideoSource, frame_times: FrameTimes, moment: Moment
) -> PersonPicture | None:
    """Return the picture of a moment with the person's skeleton, None if the video has no image of it."""
    time_s = float(frame_times.time_s[moment.frame_index])
    if source.reader is None:
        rgb = np.full((*source.size_px[::-1], 3), BACKGROUND, dtype=np.uint8)
    else:
        image = VideoCursor(source, frame_times, time_s).at(time_s)
        if image is None:
            return None
        rgb = image.rgb.copy()
    area_px = source.size_px if source.reader is None else shown_area_px(source.camera, source.reader.info)
    style = DrawingStyle.of(source.size_px, area_px)
    annotations = annotator.annotate(source.view, moment.frame_index)
    only = tuple(person for person in annotations.people if person.index == moment.person)
    draw(rgb, replace(annotations, people=only), [], style)
    corners = style.to_image(np.array(moment.box_px).reshape(2, 2)).ravel().tolist()
    jpeg, size = cut_out(rgb, (corners[0], corners[1], corners[2], corners[3]))
    at = f", {time_s:.2f} s" if frame_times.timed else ""
    return PersonPicture(f"{source.camera.name}, frame {annotations.number}{at}", jpeg, size)
