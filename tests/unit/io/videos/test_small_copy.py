"""Small copies keep the times of the images, and are the same bytes every time."""

import av
import numpy as np
import pytest

from posefuse.io.videos.frame_index import read_frame_index
from posefuse.io.videos.reader import open_video
from posefuse.io.videos.small_copy import write_small_copy
from posefuse.io.videos.writer import write_video
from tests.videos import RATE_HZ, coded_video, codes_of, images_of


def copied(source, target, shift_s=0.0, duration_s=100.0, from_s=0.0):
    return write_small_copy(open_video(source).info, target, lambda _, time_s: time_s + shift_s, duration_s, from_s)


def test_images_outside_the_time_range_are_left_out(tmp_path):
    source = coded_video(tmp_path / "a.mp4", 12)
    copy = copied(source, tmp_path / "b.mp4", -3 / RATE_HZ, 6 / RATE_HZ)
    assert codes_of(images_of(copy.path)) == [3, 4, 5, 6, 7, 8]
    assert (copy.n_images, copy.first_s, copy.last_s) == (6, pytest.approx(0.0), pytest.approx(5 / RATE_HZ))


def test_file_starts_with_the_first_image(tmp_path):
    copy = copied(coded_video(tmp_path / "a.mp4", 5), tmp_path / "b.mp4", 0.07)
    assert copy.first_s == pytest.approx(0.07)
    assert read_frame_index(copy.path).time_s == pytest.approx(np.arange(5) / RATE_HZ)


def test_fast_and_large_videos_are_thinned(tmp_path):
    copy = copied(coded_video(tmp_path / "a.mp4", 20, 60.0, (1280, 720)), tmp_path / "b.mp4")
    assert codes_of(images_of(copy.path)) == list(range(0, 20, 2))
    assert copy.size_px == (640, 360)
    assert images_of(copy.path)[0].shape == (360, 640, 3)


def test_variable_times_are_kept(tmp_path):
    times_s = np.array([0.0, 0.04, 0.3, 0.34, 0.9])
    with write_video(tmp_path / "a.mp4", (64, 48), 25.0) as writer:
        for time_s in times_s:
            writer.add(np.zeros((48, 64, 3), dtype=np.uint8), time_s)
    copy = copied(tmp_path / "a.mp4", tmp_path / "b.mp4")
    assert read_frame_index(copy.path).time_s == pytest.approx(times_s, abs=1e-4)


def test_every_image_is_within_half_a_second_of_a_key_frame(tmp_path):
    copy = copied(coded_video(tmp_path / "a.mp4", 20), tmp_path / "b.mp4")
    with av.open(str(copy.path)) as container:
        keys = [packet.is_keyframe for packet in container.demux(video=0) if packet.pts is not None]
    assert keys == [i % 15 == 0 for i in range(20)]


def test_rotated_videos_are_upright(tmp_path):
    """Phones store images on their side with a request to rotate them."""
    picture = np.zeros((48, 64, 3), dtype=np.uint8)
    picture[:, :32] = 255
    with write_video(tmp_path / "a.mp4", (64, 48), 25.0) as writer:
        writer.add(picture, 0.0)
    # The rotation of the track is the matrix of its header.
    data = (tmp_path / "a.mp4").read_bytes()
    upright = b"".join(n.to_bytes(4, "big") for n in (0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000))
    turned = b"".join((n % 2**32).to_bytes(4, "big") for n in (0, 0x10000, 0, -0x10000, 0, 0, 0, 0, 0x40000000))
    at = data.rindex(upright)
    (tmp_path / "a.mp4").write_bytes(data[:at] + turned + data[at + len(turned) :])
    assert open_video(tmp_path / "a.mp4").info.size_px == (48, 64)
    copy = copied(tmp_path / "a.mp4", tmp_path / "b.mp4")
    (image,) = images_of(copy.path)
    (expected,) = images_of(tmp_path / "a.mp4")
    assert image.shape == expected.shape == (64, 48, 3)
    assert np.abs(image.astype(int) - expected).mean() < 12


def test_truncated_videos_end_with_the_reason(tmp_path):
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        stream = container.add_stream("mpeg4", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        rng = np.random.default_rng(0)
        for _ in range(40):
            frame = av.VideoFrame.from_ndarray(rng.integers(0, 255, (48, 64, 3), dtype=np.uint8), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    whole = (tmp_path / "a.mkv").read_bytes()
    (tmp_path / "b.mkv").write_bytes(whole[: len(whole) // 2])
    copy = copied(tmp_path / "b.mkv", tmp_path / "c.mp4")
    assert 5 < copy.n_images < 30


def test_no_image_leaves_no_file(tmp_path):
    copy = copied(coded_video(tmp_path / "a.mp4", 5), tmp_path / "b.mp4", -10.0)
    assert copy.n_images == 0
    assert not copy.path.exists()


def test_same_video_gives_the_same_bytes(tmp_path):
    source = coded_video(tmp_path / "a.mp4", 12)
    contents = {copied(source, tmp_path / f"{i}.mp4").path.read_bytes() for i in range(2)}
    assert len(contents) == 1
