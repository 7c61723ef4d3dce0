"""Videos beside the report's 3D scene."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class PageVideo:
    """A small copy of a camera's video in a report.

    Attributes:
        camera: index of the camera in the rig.
        size_px: width and height of its images.
        area_px: width and height of the calibrated image that they show, from its top left corner.
        first_s: time of its first image in the result.
        rate_hz: images per second.
        content: the MP4 file, which the page contains; empty if it is linked.
        link: path of the MP4 file relative to the page; empty if it is contained.
        n_bytes: size of the file.
    """

    camera: int
    size_px: tuple[int, int]
    area_px: tuple[int, int]
    first_s: float
    rate_hz: float
    content: bytes = b""
    link: str = ""
    n_bytes: int = 0


@dataclass(frozen=True)
class PageVideos:
    """All videos of a report.

    Attributes:
        videos: the videos, in the order of the cameras.
        period_s: time between two frames of the result.
        start_s: time of the first frame of a result whose frames have no times.
        notes: sentences on videos that are missing or incomplete.
    """

    videos: tuple[PageVideo, ...] = ()
    period_s: float = 0.0
    start_s: float = 0.0
    notes: tuple[str, ...] = ()


def video_data(page: PageVideos) -> dict[str, Any]:
    """Return the JSON data of the videos."""
    return {
        "period": round(page.period_s, 6),
        "start": round(page.start_s, 6),
        "films": [
            {
                "camera": video.camera,
                "size": list(video.size_px),
                "area": list(video.area_px),
                "first": round(video.first_s, 6),
                "rate": round(video.rate_hz, 4),
                "link": video.link,
                "content": base64.b64encode(video.content).decode("ascii"),
            }
            for video in page.videos
        ],
    }


def videos_sentence(videos: Sequence[PageVideo], notes: Sequence[str]) -> str:
    """Return what the page states about its videos; empty without any."""
    sentences = []
    if videos:
        total = sum(video.n_bytes for video in videos) / 1e6
        linked = next((video.link.rpartition("/")[0] for video in videos if video.link), "")
        where = f"in the folder {linked} beside this page" if linked else "contained in this page"
        count = "A small copy of 1 video" if len(videos) == 1 else f"Small copies of {len(videos)} videos"
        sentences.append(f"{count}, {total:.1f} MB, {where}.")
    return " ".join([*sentences, *notes])
