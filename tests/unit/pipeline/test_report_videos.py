"""Reports with videos: contained or linked, on the clock of the result, with a sentence on what is missing."""

import base64
import json
import re
from dataclasses import replace

import pytest

from posefuse.errors import FileError, MatchError, OutputExistsError
from posefuse.model.options.sync import SyncOptions
from posefuse.pipeline import report_videos
from posefuse.pipeline.report_videos import write_report
from tests.videos import N_FRAMES, RATE_HZ, SIZE_PX, coded_video, codes_of, images_of, moving_sticks


@pytest.fixture(scope="module")
def result():
    return moving_sticks()


@pytest.fixture(scope="module")
def videos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("videos")
    return {f"cam{i}": coded_video(folder / f"cam{i}.mp4") for i in range(2)}


def page_of(path):
    text = path.read_text("utf-8")
    data = re.search(r'<script id="data" type="application/json">(.*?)</script>', text, re.DOTALL)
    return text, json.loads(data.group(1))["videos"]


def codes_in(film, folder):
    path = folder / "film.mp4"
    path.write_bytes(base64.b64decode(film["content"]))
    return codes_of(images_of(path))


def test_short_videos_are_contained(tmp_path, result, videos):
    (path,) = write_report(result, tmp_path / "report.html", videos=videos)
    text, data = page_of(path)
    assert "Small copies of 2 videos" in text
    assert [film["camera"] for film in data["films"]] == [0, 1]
    assert codes_in(data["films"][0], tmp_path) == list(range(N_FRAMES))
    assert write_report(result, path, videos=videos, overwrite=True) == (path,)
    assert path.read_text("utf-8") == text


def test_large_videos_are_files_beside_the_page(tmp_path, monkeypatch, result, videos):
    monkeypatch.setattr(report_videos, "EMBEDDED_BYTES", 100)
    path, *files = write_report(result, tmp_path / "report.html", videos=videos)
    text, data = page_of(path)
    assert [file.relative_to(tmp_path).as_posix() for file in files] == [film["link"] for film in data["films"]]
    assert files[0] == tmp_path / "report_videos" / "cam0.mp4"
    assert codes_of(images_of(files[1])) == list(range(N_FRAMES))
    assert "in the folder report_videos beside this page" in text


def test_videos_are_on_the_clock_of_the_result(tmp_path, result, videos):
    """The second view is 4 frames late; the first video starts 2 frames after the result."""
    sync = SyncOptions(("cam1",), (0.0,), (4 / RATE_HZ,), (0.0,))
    synchronized = replace(result, options=replace(result.options, sync=sync))
    (path,) = write_report(synchronized, tmp_path / "report.html", videos=videos, offset_s={"cam0": 2 / RATE_HZ})
    first, second = page_of(path)[1]["films"]
    assert (first["first"], second["first"]) == pytest.approx((2 / RATE_HZ, 4 / RATE_HZ))
    assert codes_in(first, tmp_path) == list(range(N_FRAMES - 2))
    assert codes_in(second, tmp_path) == list(range(N_FRAMES - 4))


def test_missing_and_unsuitable_videos_have_a_sentence(tmp_path, result, videos):
    short = coded_video(tmp_path / "short.mp4", 5)
    turned = coded_video(tmp_path / "turned.mp4", size_px=SIZE_PX[::-1])
    (path,) = write_report(result, tmp_path / "report.html", videos={"cam0": short, "cam1": turned})
    text, data = page_of(path)
    assert "short.mp4 ends at 0.16 s." in text
    assert "The video of cam1 is not shown: turned.mp4 is 240 x 320 px" in text
    assert len(data["films"]) == 1


def test_folders_of_pictures_are_left_out(tmp_path, result, videos):
    (path,) = write_report(result, tmp_path / "report.html", videos={"cam0": tmp_path, "cam1": videos["cam1"]})
    text, data = page_of(path)
    assert "The images of cam0 are a folder of pictures, which is not shown." in text
    assert [film["camera"] for film in data["films"]] == [1]


def test_padded_images_show_the_top_left_of_the_calibrated_one(tmp_path, result, videos):
    cropped = coded_video(tmp_path / "a.mp4", size_px=(SIZE_PX[0] - 8, SIZE_PX[1]))
    (path,) = write_report(result, tmp_path / "report.html", videos={"cam0": cropped})
    (film,) = page_of(path)[1]["films"]
    assert film["area"] == [SIZE_PX[0] - 8, SIZE_PX[1]]


def test_wrong_arguments_leave_no_page(tmp_path, result, videos):
    path = tmp_path / "report.html"
    with pytest.raises(MatchError, match="no camera 'cam9'"):
        write_report(result, path, videos={"cam9": videos["cam0"]})
    with pytest.raises(FileError):
        write_report(result, path, videos={"cam0": tmp_path / "none.mp4"})
    assert not path.exists()
    path.write_text("mine")
    with pytest.raises(OutputExistsError):
        write_report(result, path)
    assert path.read_text() == "mine"
