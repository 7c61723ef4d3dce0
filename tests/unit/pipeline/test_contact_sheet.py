"""Contact sheets take their pictures from the videos at the time of the result."""

import base64
import io
import re

import numpy as np
import pytest
from PIL import Image

from posefuse.errors import FileError, MatchError, OutputExistsError
from posefuse.pipeline.contact_sheet import write_contact_sheet
from tests.videos import SIZE_PX, coded_video, moving_sticks


def pictures_in(page: str) -> list[np.ndarray]:
    return [
        np.asarray(Image.open(io.BytesIO(base64.b64decode(data)))) for data in re.findall(r"base64,([^\"]+)\"", page)
    ]


def test_pictures_are_of_the_frame_that_they_state(tmp_path):
    video = coded_video(tmp_path / "cam0.mp4")
    write_contact_sheet(moving_sticks(), tmp_path / "people.html", videos={"cam0": video})
    page = (tmp_path / "people.html").read_text("utf-8")
    frames = [int(number) for number in re.findall(r"<figcaption>cam0, frame (\d+)", page)]
    pictures = pictures_in(page)
    assert len(frames) == len(pictures) == 2
    for number, picture in zip(frames, pictures, strict=True):
        assert round((float(np.median(picture)) - 20) / 10) == number
    assert "--person person_2" in page
    assert "active in 100% of the frames" in page


def test_without_videos_the_skeletons_are_drawn(tmp_path):
    write_contact_sheet(moving_sticks(), tmp_path / "people.html")
    page = (tmp_path / "people.html").read_text("utf-8")
    assert "the pictures show the skeletons only" in page
    assert len(pictures_in(page)) == 4
    assert all(picture.max() > 150 for picture in pictures_in(page))


def test_wrong_videos_are_stated_and_existing_pages_kept(tmp_path):
    turned = coded_video(tmp_path / "turned.mp4", size_px=SIZE_PX[::-1])
    write_contact_sheet(moving_sticks(), tmp_path / "people.html", videos={"cam0": turned})
    page = (tmp_path / "people.html").read_text("utf-8")
    assert "The video of cam0 is not shown" in page
    with pytest.raises(OutputExistsError):
        write_contact_sheet(moving_sticks(), tmp_path / "people.html")
    with pytest.raises(FileError, match="must end in .html"):
        write_contact_sheet(moving_sticks(), tmp_path / "people")
    with pytest.raises(MatchError, match="no camera 'cam7'"):
        write_contact_sheet(moving_sticks(), tmp_path / "b.html", videos={"cam7": turned})
