"""Sound is placed by its timestamps relative to the first image."""

from fractions import Fraction

import av
import numpy as np
import pytest

from posefuse.errors import FileError
from posefuse.io.videos.sound import read_sound
from tests.sounds import RATE_HZ, write_sounding_video

CLICKS_S = (0.5, 1.5, 2.5)


def clicks() -> np.ndarray:
    sound = np.zeros(3 * RATE_HZ, dtype=np.float32)
    sound[[round(time_s * RATE_HZ) for time_s in CLICKS_S]] = 0.9
    return sound


@pytest.mark.parametrize("sound_start_s", [0.0, -0.023, 0.04])
@pytest.mark.parametrize(("ending", "codec"), [(".mp4", "aac"), (".mov", "pcm_s16le"), (".mkv", "libopus")])
def test_times_count_from_the_first_image(tmp_path, ending, codec, sound_start_s):
    path = write_sounding_video(tmp_path / f"a{ending}", clicks(), sound_start_s=sound_start_s, codec=codec)
    sound = read_sound(path, "a")
    assert sound.problem == ""
    for time_s in CLICKS_S:
        first_s = time_s + sound_start_s - 0.2
        heard = sound.between(first_s, round(0.4 * RATE_HZ))
        assert int(np.argmax(np.abs(heard))) / RATE_HZ == pytest.approx(0.2, abs=0.0015)


def test_gaps_are_silence(tmp_path):
    """A recording program that loses sound leaves a gap in the timestamps."""
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=48_000, layout="stereo")
        for first_s in (0.0, 1.2):
            samples = np.zeros((1, 2 * 48_000), dtype=np.int16)
            samples[0, 24_000:24_002] = 20_000
            frame = av.AudioFrame.from_ndarray(samples, format="s16", layout="stereo")
            frame.sample_rate, frame.pts, frame.time_base = 48_000, round(first_s * 48_000), Fraction(1, 48_000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    sound = read_sound(path, "a")
    loud = np.flatnonzero(np.abs(sound.samples) > 0.1) / RATE_HZ
    assert (loud.min(), loud.max()) == pytest.approx((0.25, 1.45), abs=0.001)
    assert sound.duration_s == pytest.approx(2.2, abs=0.01)


def test_missing_and_silent_sound_are_stated(tmp_path):
    assert read_sound(write_sounding_video(tmp_path / "a.mp4", None), "a").problem == "has no sound track"
    silent = write_sounding_video(tmp_path / "b.mp4", np.zeros(RATE_HZ, dtype=np.float32))
    assert read_sound(silent, "b").problem == "is silent"


def test_sound_before_the_end_of_a_truncated_file_is_kept(tmp_path):
    whole = write_sounding_video(tmp_path / "a.mkv", clicks(), codec="pcm_s16le").read_bytes()
    (tmp_path / "b.mkv").write_bytes(whole[: 2 * len(whole) // 3])
    sound = read_sound(tmp_path / "b.mkv", "b")
    assert 1.0 < sound.duration_s < 2.9


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"no video")
    with pytest.raises(FileError, match="cannot be read as a video"):
        read_sound(tmp_path / "a.mp4", "a")
    with pytest.raises(FileError):
        read_sound(tmp_path / "b.mp4", "b")
