"""Runs from unusual and broken videos: a correct result, or one sentence before any file is written."""

import shutil
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest

import posefuse
from posefuse import RunOptions
from posefuse.errors import PosefuseError
from posefuse.io.calibration import anipose
from posefuse.model.options.detection import DetectOptions
from tests.coded_videos import SIZE_PX, FilmedPerson, coded_image, film_person

DURATION_S = 3.0


@pytest.fixture(scope="module")
def filmed(tmp_path_factory) -> tuple[Path, FilmedPerson]:
    folder = tmp_path_factory.mktemp("filmed")
    return folder, film_person(folder, n=3, duration_s=DURATION_S, rates_hz=(25.0, 25.0, 50.0))


@pytest.fixture
def take(filmed, tmp_path) -> Path:
    """A recording of three cameras, one of which has twice the frame rate, and their calibration."""
    shutil.copytree(filmed[0], tmp_path / "take")
    anipose.write(filmed[1].rig, tmp_path / "take" / "calibration.toml")
    return tmp_path / "take"


def encode(
    path: Path,
    images: list[np.ndarray],
    *,
    codec: str = "libx264",
    pixels: str = "yuv420p",
    size_px: tuple[int, int] = SIZE_PX,
) -> None:
    """Write images of 25 Hz with a codec and pixel format."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options={"crf": "10"} if codec.startswith("libx26") else {})
        stream.width, stream.height = size_px
        stream.pix_fmt = pixels
        for number, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def images_of_view(view: int, n: int = 75) -> list[np.ndarray]:
    return [coded_image(view, number) for number in range(n)]


def shorter(take: Path) -> None:
    encode(take / "cam_1.mp4", images_of_view(1, 45))


def ten_bit(take: Path) -> None:
    encode(take / "cam_1.mp4", images_of_view(1), codec="libx265", pixels="yuv420p10le")


def other_codec(take: Path) -> None:
    (take / "cam_1.mp4").unlink()
    encode(take / "cam_1.avi", images_of_view(1), codec="mjpeg", pixels="yuvj420p")


def truncated(take: Path) -> None:
    encode(take / "cam_1.mkv", images_of_view(1))
    content = (take / "cam_1.mkv").read_bytes()
    (take / "cam_1.mkv").write_bytes(content[: 2 * len(content) // 3])
    (take / "cam_1.mp4").unlink()


def black(take: Path) -> None:
    encode(take / "cam_1.mp4", [np.zeros((SIZE_PX[1], SIZE_PX[0], 3), np.uint8)] * 75)


def detector_of(person: FilmedPerson) -> Callable[[np.ndarray], np.ndarray | None]:
    """The detector of coded images, which finds no person in black ones."""
    return lambda image: person.detector(image) if image[60:, :, :].mean() > 30.0 else None


@pytest.mark.parametrize("change", [None, shorter, ten_bit, other_codec, truncated, black])
def test_result_is_right(filmed, take, tmp_path, change):
    if change is not None:
        change(take)
    person = filmed[1]
    options = RunOptions(synchronize="off")
    outcome = posefuse.run(take, tmp_path / "out", options, detector=detector_of(person), skeleton=person.skeleton)
    assert outcome.reconstruction is not None
    layer = outcome.reconstruction.open().best_layer()[1]
    assert np.nanmedian(layer.reprojection_error_px) < 1.5
    assert np.isfinite(layer.points_m[..., 0]).mean() > 0.5
    assert (tmp_path / "out" / "report.html").is_file()


def unreadable(take: Path) -> None:
    content = (take / "cam_1.mp4").read_bytes()
    (take / "cam_1.mp4").write_bytes(content[: len(content) // 2][::-1])


def empty(take: Path) -> None:
    (take / "cam_1.mp4").write_bytes(b"")


def resolution(take: Path) -> None:
    encode(take / "cam_1.mp4", [np.kron(coded_image(1, 0), np.ones((2, 2, 1), np.uint8))] * 3, size_px=(640, 360))


def four_k(take: Path) -> None:
    encode(take / "cam_1.mp4", [np.zeros((2160, 3840, 3), np.uint8)] * 2, size_px=(3840, 2160))


def rotated(take: Path) -> None:
    encode(take / "cam_1.mp4", [np.rot90(each) for each in images_of_view(1, 3)], size_px=SIZE_PX[::-1])


def unknown_codec(take: Path) -> None:
    """A codec that no decoder knows: the code of H.264 in the header is replaced."""
    content = (take / "cam_1.mp4").read_bytes()
    assert content.count(b"avc1") >= 1
    (take / "cam_1.mp4").write_bytes(content.replace(b"avc1", b"zzz9"))


def twice(take: Path) -> None:
    shutil.copy(take / "cam_0.mp4", take / "cam_1.mp4")


def sound_only(take: Path) -> None:
    with av.open(str(take / "cam_1.mp4"), "w") as container:
        stream = container.add_stream("aac", rate=16_000, layout="mono")
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 16_000), np.float32), format="fltp", layout="mono")
        frame.sample_rate = 16_000
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (unreadable, "cam_1.mp4 cannot be read as a video"),
        (empty, "cam_1.mp4 cannot be read as a video"),
        (resolution, "640 x 360 px, but camera 'cam_1' was calibrated at 320 x 180 px"),
        (four_k, "3840 x 2160 px, but camera 'cam_1' was calibrated at 320 x 180 px"),
        (rotated, "rotated by a quarter turn"),
        (unknown_codec, "cam_1.mp4 has a codec that PyAV cannot decode"),
        (twice, "cam_0.mp4 and cam_1.mp4 are the same video"),
        (sound_only, "cam_1.mp4 has no video stream"),
    ],
)
def test_one_sentence_before_the_work(filmed, take, tmp_path, change, message):
    change(take)
    with pytest.raises(PosefuseError) as raised:
        posefuse.run(take, tmp_path / "out", detector=filmed[1].detector, skeleton=filmed[1].skeleton)
    assert message in str(raised.value)
    assert len(str(raised.value).splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_detector_or_extra_that_is_not_installed(take, tmp_path, monkeypatch):
    monkeypatch.setenv("POSEFUSE_HOME", str(tmp_path / "home"))
    for name in ("mediapipe", "rtmpose"):
        plan = posefuse.plan_run(take, RunOptions(detect=DetectOptions(detector=name)))
        (problem,) = plan.problems
        assert f"posefuse detector install {name}" in problem
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    assert any("pip install 'posefuse[video]'" in problem for problem in posefuse.plan_run(take).problems)
