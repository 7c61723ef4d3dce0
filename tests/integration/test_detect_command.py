"""``posefuse detect``: its arguments and what it prints."""

from pathlib import Path

import pytest

from posefuse.cli.detect import describe, videos_given
from posefuse.cli.main import main
from posefuse.errors import OptionsError
from posefuse.pipeline.detect import Given, detect_videos
from posefuse.pipeline.detection import chunks
from tests.filmed_blobs import BAR, film, find_bars


def test_videos_are_folders_files_or_named(tmp_path):
    assert videos_given(("a", "b.mp4")) == [Path("a"), Path("b.mp4")]
    assert videos_given(("left=a.mp4", "right=b.mp4")) == {"left": Path("a.mp4"), "right": Path("b.mp4")}
    (tmp_path / "a=b").mkdir()
    assert videos_given((str(tmp_path / "a=b"),)) == [tmp_path / "a=b"]
    with pytest.raises(OptionsError, match=r"b\.mp4: expected CAMERA=FILE"):
        videos_given(("left=a.mp4", "b.mp4"))
    with pytest.raises(OptionsError, match="Two videos are given for camera 'left'"):
        videos_given(("left=a.mp4", "left=b.mp4"))


def test_views_without_people_are_named(tmp_path, capsys):
    film(tmp_path / "full.mp4", 12)
    film(tmp_path / "empty.mp4", 12, people=0)
    describe(detect_videos(tmp_path, tmp_path / "out", given=Given(find_bars, BAR)))
    printed = capsys.readouterr()
    assert "No person was found in view 'empty'." in printed.err
    assert "24 images by find_bars in" in printed.out
    assert f"Wrote {tmp_path / 'out' / 'keypoints.parquet'}" in printed.out.replace("\n", "")
    describe(detect_videos(tmp_path, tmp_path / "out", given=Given(find_bars, BAR)))
    assert "Nothing to detect:" in capsys.readouterr().out


WORKER = """
import os
from pathlib import Path
import numpy as np

class Detector:
    skeleton = ["left_end", "middle", "right_end"]
    version = "1"
    several_people = False

    def __init__(self, settings):
        limit = Path(__file__).with_name("limit")
        self.left = int(limit.read_text()) if limit.exists() else 1000

    def detect(self, images):
        found = []
        for image in images:
            self.left -= 1
            if self.left < 0:
                os._exit(3)
            rows, columns = np.nonzero(image[..., 1] > 120)
            x, y = [columns.min(), columns.mean(), columns.max()], rows.mean()
            found.append(np.array([[[each, y, 0.9] for each in x]]))
        return found
"""


def test_a_crash_of_a_worker_is_one_sentence_and_resumes(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(chunks, "CHUNK_IMAGES", 10)
    (tmp_path / "videos").mkdir()
    for name, gop in (("a", 10), ("b", 100)):
        film(tmp_path / "videos" / f"{name}.mp4", 40, gop=gop)
    (tmp_path / "bars.py").write_text(WORKER)
    call = ["detect", str(tmp_path / "videos"), "--detector", str(tmp_path / "bars.py"), "--jobs", "2", "--output"]
    main([*call, str(tmp_path / "whole")])
    (tmp_path / "limit").write_text("22")
    with pytest.raises(SystemExit, match="1"):
        main([*call, str(tmp_path / "crashed")])
    captured = " ".join(capsys.readouterr().err.split())
    assert "error: The detector bars ended with exit code 3." in captured
    assert "Traceback" not in captured
    (tmp_path / "limit").unlink()
    main([*call, str(tmp_path / "crashed")])
    assert "note: Resuming:" in capsys.readouterr().out
    for file in ("keypoints.parquet", "detection.json"):
        assert (tmp_path / "crashed" / file).read_bytes() == (tmp_path / "whole" / file).read_bytes()
