"""Detection in videos: true times, the same bytes after any interruption, and bad input."""

import json
import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import posefuse
from posefuse.errors import DetectionsError, DetectorError, FileError, OptionsError, OutputExistsError, RecordingError
from posefuse.model.options.detection import DetectOptions
from posefuse.pipeline.detect import Given, detect, detect_videos
from posefuse.pipeline.detection import chunks
from tests.conftest import ROOT
from tests.filmed_blobs import BAR, bar_place, film, find_bars, lefts_of
from tests.workers import BRIGHTNESS, worker_file

FILES = ("keypoints.parquet", "detection.json")


@pytest.fixture
def small_chunks(monkeypatch):
    monkeypatch.setattr(chunks, "CHUNK_IMAGES", 10)


def content_of(folder: Path) -> list[bytes]:
    return [(folder / name).read_bytes() for name in FILES]


def test_the_output_is_read_as_keypoints(tmp_path, small_chunks):
    film(tmp_path / "left.mp4", 30, people=2)
    film(tmp_path / "right.mp4", 24)
    found = detect(tmp_path, find_bars, skeleton=BAR, output=tmp_path / "keypoints")
    assert posefuse.read_detections(tmp_path / "keypoints") == found
    assert posefuse.read_detections(tmp_path / "keypoints" / "keypoints.parquet") == found
    assert detect(tmp_path, find_bars, skeleton=BAR) == found
    assert found.recorded.sum(axis=0).tolist() == [30, 24]


def test_frame_times_of_a_variable_rate_are_exact(tmp_path, small_chunks):
    ticks = np.concatenate([[0], np.cumsum(np.random.default_rng(0).integers(2000, 5000, 34))])
    film(tmp_path / "left.mp4", ticks / 90_000, people=2)
    found = detect(tmp_path, find_bars, skeleton=BAR)
    np.testing.assert_allclose(found.time_s[:, 0], ticks / 90_000, atol=1e-9)
    assert found.people_counts[:, 0].tolist() == [2] * 35
    assert lefts_of(found.keypoints_px[::2]) == [bar_place(number)[0] for number in range(35)]
    assert found.view_names == ("left",)


def test_people_of_a_view_are_linked(tmp_path, small_chunks):
    film(tmp_path / "a.mp4", 25, people=3)
    found = detect(tmp_path / "a.mp4", find_bars, skeleton=BAR)
    assert found.track_ids.reshape(25, 3).tolist() == [[0, 1, 2]] * 25


def test_views_of_different_length_and_rate(tmp_path, small_chunks):
    film(tmp_path / "a.mp4", 30)
    film(tmp_path / "b.mp4", np.arange(36) / 30.0)
    outcome = detect_videos(tmp_path, tmp_path / "out", given=Given(find_bars, BAR))
    assert [(view.n_images, round(view.rate_hz or 0)) for view in outcome.views] == [(30, 25), (36, 30)]
    found = posefuse.read_detections(outcome.keypoints)
    assert found.rate_hz == pytest.approx(25.0, rel=1e-3)
    spread = np.ptp(found.time_s[found.recorded.all(axis=1)], axis=1)
    assert spread.max() <= 0.02 + 1e-6


def test_every_image_and_a_range_of_time(tmp_path, small_chunks):
    film(tmp_path / "a.mp4", 50)
    found = detect(tmp_path, find_bars, DetectOptions(every=5, start_s=0.5, end_s=1.5), skeleton=BAR)
    np.testing.assert_allclose(found.time_s[:, 0], np.arange(15, 38, 5) / 25.0, atol=1e-9)
    assert found.rate_hz == pytest.approx(5.0, rel=1e-3)
    assert lefts_of(found.keypoints_px) == [bar_place(number)[0] for number in range(15, 38, 5)]


def test_a_part_and_the_number_of_people(tmp_path, small_chunks):
    film(tmp_path / "a.mp4", 20, people=3)
    found = detect(tmp_path, find_bars, DetectOptions(crop=("a=0,20,90,44",), max_people=1), skeleton=BAR)
    np.testing.assert_allclose(found.keypoints_px[:, 0, 1], bar_place(0, 1)[1] + 2.5, atol=0.6)


def test_an_interrupted_run_continues_to_the_same_bytes(tmp_path, small_chunks):
    """Interrupted at three random images, with detectors that fail there."""
    for name in ("a", "b"):
        film(tmp_path / f"{name}.mp4", 45, people=2, gop=10 if name == "a" else 100)
    detect(tmp_path, find_bars, skeleton=BAR, output=tmp_path / "whole")
    rng, examined = np.random.default_rng(5), 0

    class Failing:
        __code__ = find_bars.__code__  # the same detector
        __name__ = find_bars.__name__

        def __init__(self, after: int):
            self.after = after

        def __call__(self, image):
            nonlocal examined
            if self.after == 0:
                raise MemoryError
            self.after, examined = self.after - 1, examined + 1
            return find_bars(image)

    for _ in range(3):
        with pytest.raises(DetectorError):
            detect(tmp_path, Failing(int(rng.integers(12, 30))), skeleton=BAR, output=tmp_path / "parts")
        assert not (tmp_path / "parts" / "keypoints.parquet").exists()
    detect(tmp_path, Failing(10**6), skeleton=BAR, output=tmp_path / "parts")
    assert content_of(tmp_path / "parts") == content_of(tmp_path / "whole")
    assert sorted(path.name for path in (tmp_path / "parts").iterdir()) == sorted(FILES)
    assert examined < 90 + 3 * 15


def test_a_function_is_identified_by_its_code(tmp_path, small_chunks):
    """Not by its place in memory, which differs between processes: even of functions inside it."""

    def made(threshold: int):
        namespace: dict = {"find_bars": find_bars}
        text = f"def found(image):\n    return (lambda: find_bars(image * (image > {threshold})))()"
        exec(text, namespace)
        return namespace["found"]

    film(tmp_path / "a.mp4", 12)
    keys = []
    for name, function in (("1", made(50)), ("2", made(50)), ("3", made(60))):
        detect(tmp_path, function, skeleton=BAR, output=tmp_path / name)
        keys.append(json.loads((tmp_path / name / "detection.json").read_text())["key"])
    assert keys[0] == keys[1] != keys[2]


SCRIPT = """
import os, signal, sys
import numpy as np
from pathlib import Path
from posefuse.pipeline.detect import detect
from posefuse.pipeline.detection import chunks
from tests.filmed_blobs import BAR, find_bars
chunks.CHUNK_IMAGES = 10
left = [int(sys.argv[3])]
def detector(image):
    left[0] -= 1
    if not left[0]:
        os.kill(os.getpid(), signal.SIGKILL)
    return find_bars(image)
detect(Path(sys.argv[1]), detector, skeleton=BAR, output=Path(sys.argv[2]))
"""


def run_until(videos: Path, output: Path, images: int) -> int:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)])}
    command = [sys.executable, "-c", SCRIPT, str(videos), str(output), str(images)]
    return subprocess.run(command, env=environment, check=False, capture_output=True, timeout=120).returncode


@pytest.mark.long
def test_killed_at_random_moments_gives_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        film(tmp_path / f"{name}.mp4", 60, people=2, gop=12 if name == "a" else 100)
    assert run_until(tmp_path, tmp_path / "whole", -1) == 0
    rng = np.random.default_rng(8)
    for _ in range(5):
        assert run_until(tmp_path, tmp_path / "killed", int(rng.integers(11, 20))) == -signal.SIGKILL
    assert run_until(tmp_path, tmp_path / "killed", -1) == 0
    assert content_of(tmp_path / "killed") == content_of(tmp_path / "whole")


WORKERS = """
import sys
from pathlib import Path
from posefuse.model.options.detection import DetectOptions
from posefuse.pipeline.detect import detect
from posefuse.pipeline.detection import chunks
chunks.CHUNK_IMAGES = 10
options = DetectOptions(detector=sys.argv[3], device="cpu", jobs=2)
detect(Path(sys.argv[1]), options=options, output=Path(sys.argv[2]))
"""


def start_workers(videos: Path, output: Path, detector: Path) -> "subprocess.Popen[bytes]":
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)])}
    command = [sys.executable, "-c", WORKERS, str(videos), str(output), str(detector)]
    return subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)


@pytest.mark.long
def test_two_workers_killed_at_random_moments_give_the_same_bytes(tmp_path):
    """The worker's keypoints depend on all images since the last reset, so that a wrong start changes them."""
    videos = tmp_path / "videos"
    videos.mkdir()
    for name in ("a", "b"):
        film(videos / f"{name}.mp4", 80, people=2, gop=12 if name == "a" else 100)
    detector = worker_file(
        tmp_path, BRIGHTNESS.replace("        for image in", "        time.sleep(0.1)\n        for image in")
    )
    detector.write_text("import time\n" + detector.read_text())
    assert start_workers(videos, tmp_path / "whole", detector).wait(timeout=120) == 0
    rng = np.random.default_rng(4)
    parts, killed = tmp_path / "killed" / ".parts", 0
    for _ in range(5):
        before, process = len(list(parts.glob("*"))), start_workers(videos, tmp_path / "killed", detector)
        while process.poll() is None and len(list(parts.glob("*"))) <= before:
            time.sleep(0.005)
        time.sleep(rng.uniform(0.0, 0.2))
        process.kill()
        killed += process.wait(timeout=20) == -signal.SIGKILL
        assert parts.is_dir()
    assert killed == 5
    assert start_workers(videos, tmp_path / "killed", detector).wait(timeout=120) == 0
    assert content_of(tmp_path / "killed") == content_of(tmp_path / "whole")


def test_a_finished_run_is_not_repeated(tmp_path, small_chunks):
    film(tmp_path / "a.mp4", 20)
    first = detect_videos(tmp_path, tmp_path / "out", given=Given(find_bars, BAR))
    again = detect_videos(tmp_path, tmp_path / "out", given=Given(find_bars, BAR))
    assert (first.n_images, again.n_images, again.views) == (20, 0, first.views)
    with pytest.raises(OutputExistsError, match="keypoints.parquet already exists, of other videos, options"):
        detect_videos(tmp_path, tmp_path / "out", DetectOptions(every=2), Given(find_bars, BAR))
    other = detect_videos(tmp_path, tmp_path / "out", DetectOptions(every=2), Given(find_bars, BAR), overwrite=True)
    assert other.n_images == 10


def test_the_description_states_what_the_detections_depend_on(tmp_path, small_chunks):
    film(tmp_path / "a.mp4", 12)
    detect(tmp_path, find_bars, skeleton=BAR, output=tmp_path / "out")
    content = json.loads((tmp_path / "out" / "detection.json").read_text())
    assert content["detector"]["name"] == "find_bars"
    assert content["videos"]["a"]["size_px"] == [96, 64]
    assert str(tmp_path) not in json.dumps(content)


def test_videos_without_people_and_black_ones(tmp_path, small_chunks):
    film(tmp_path / "a.mp4", 12, people=0)
    found = detect(tmp_path, find_bars, skeleton=BAR)
    assert found.people_counts.sum() == 0
    assert found.recorded.all()


def test_a_video_that_breaks_off_is_used_up_to_there(tmp_path, small_chunks):
    path = film(tmp_path / "a.avi", 40, codec="mjpeg", pixels="yuvj420p")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    outcome = detect_videos(tmp_path, tmp_path / "out", given=Given(find_bars, BAR))
    assert 10 < outcome.views[0].n_images < 30
    assert outcome.notes[0].startswith("View 'a': a.avi breaks off: its header states 40 images, and it holds")
    assert posefuse.read_detections(outcome.keypoints).notes[0] == outcome.notes[0]


def test_rotated_videos_are_upright(tmp_path, small_chunks):
    film(tmp_path / "flat.mp4", 12)
    found = detect(_with_rotation(tmp_path / "flat.mp4", tmp_path / "turned.mp4"), find_bars_upright, skeleton=BAR)
    # A quarter turn clockwise moves (column, row) to (height - 1 - row, column).
    left, top = bar_place(0)
    np.testing.assert_allclose(found.keypoints_px[0, 0], [64 - 1 - (top + 2.5), left], atol=0.6)


def find_bars_upright(image: np.ndarray) -> np.ndarray:
    """Return the bars of an image that was turned clockwise."""
    assert image.shape == (96, 64, 3)
    found = find_bars(np.rot90(image, 1))
    x, y = found[..., 0].copy(), found[..., 1].copy()
    found[..., 0], found[..., 1] = 64 - 1 - y, x
    return found


def _with_rotation(source: Path, target: Path) -> Path:
    """Return a copy of a video with the flag of a quarter turn clockwise."""
    content = bytearray(source.read_bytes())
    at = content.index(b"tkhd") + 44
    content[at : at + 36] = struct.pack(">9i", 0, 0x10000, 0, -0x10000, 0, 0, 64 << 16, 0, 0x40000000)
    target.write_bytes(content)
    return target


def test_bad_input_is_one_sentence_and_leaves_nothing(tmp_path, small_chunks):
    film(tmp_path / "a.mp4", 12)
    (tmp_path / "same").mkdir()
    for name in ("a", "b"):
        (tmp_path / "same" / f"{name}.mp4").write_bytes((tmp_path / "a.mp4").read_bytes())
    broken = tmp_path / "broken.mp4"
    broken.write_bytes((tmp_path / "a.mp4").read_bytes()[:400])
    out = tmp_path / "out"

    def refused(error, match, videos=tmp_path / "a.mp4", options=None, detector=find_bars):
        with pytest.raises(error, match=match):
            detect(videos, detector, options, skeleton=BAR, output=out)
        assert not out.exists()

    refused(RecordingError, "The views 'a' and 'b' have the same content", tmp_path / "same")
    refused(FileError, "broken.mp4 cannot be read as a video", broken)
    refused(FileError, "No video or folder of videos at", tmp_path / "absent.mp4")
    refused(DetectionsError, "No image of a lies in the selected time", options=DetectOptions(start_s=9.0))
    refused(OptionsError, "crop names c, but the views are a", options=DetectOptions(crop=("c=0,0,5,5",)))
    refused(DetectorError, "The detector find_wrong returned an array", detector=find_wrong)
    (tmp_path / "file").write_text("")
    out = tmp_path / "file"
    with pytest.raises(FileError, match="file"):
        detect(tmp_path / "a.mp4", find_bars, skeleton=BAR, output=out)


def find_wrong(image: np.ndarray) -> np.ndarray:
    """Return an array of the wrong shape."""
    return np.zeros((1, 2, 3))
