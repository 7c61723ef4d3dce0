"""What a report states about its videos."""

import base64

from posefuse.report.videos import PageVideo, PageVideos, video_data, videos_sentence

FILM = PageVideo(1, (320, 240), (640.0, 480.0), 0.02, 25.0, content=b"film", n_bytes=1_200_000)


def test_sentence_states_number_size_and_place():
    linked = PageVideo(0, (320, 240), (640.0, 480.0), 0.0, 25.0, link="report_videos/cam0.mp4", n_bytes=9_000_000)
    assert videos_sentence([FILM], []) == "A small copy of 1 video, 1.2 MB, contained in this page."
    assert videos_sentence([linked, linked], ["a.mp4 ends at 2.00 s."]) == (
        "Small copies of 2 videos, 18.0 MB, in the folder report_videos beside this page. a.mp4 ends at 2.00 s."
    )
    assert videos_sentence([], []) == ""


def test_data_contain_the_file():
    data = video_data(PageVideos((FILM,), 0.04))
    assert base64.b64decode(data["films"][0]["content"]) == b"film"
    assert data["films"][0]["camera"] == 1
    assert data["period"] == 0.04
