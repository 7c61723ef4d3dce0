"""C3D files of other programs, other processors and integer data, and corrupt files."""

import struct

import ezc3d
import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError, PosefuseError
from posefuse.io.results import c3d_reading
from tests.broken import broken

LABELS = ("LASI", "S:RASI", "")


def write_with_ezc3d(path, points_mm, rate=100.0, unit="mm", first=0):
    content = ezc3d.c3d()
    point = content["parameters"]["POINT"]
    point["RATE"]["value"], point["UNITS"]["value"], point["LABELS"]["value"] = [rate], [unit], list(LABELS)
    content["header"]["points"]["first_frame"] = first
    content["data"]["points"] = np.concatenate([points_mm, np.ones_like(points_mm[:1])])
    content["data"]["analogs"] = np.zeros((1, 0, 0))
    content.write(str(path))
    return path


def parameter(group, name, kind, axes, content, order):
    about = struct.pack("bB", kind, len(axes)) + bytes(axes) + content + b"\0"
    return struct.pack("bb", len(name), group) + name.encode() + struct.pack(order + "H", len(about) + 2) + about


def floats(values, processor):
    if processor == 85:
        return np.asarray(4.0 * np.asarray(values), "<f4").view("<u2").reshape(-1, 2)[:, ::-1].tobytes()
    return np.asarray(values, ">f4" if processor == 86 else "<f4").tobytes()


def write_by_hand(path, points, words, processor, scale, analog=0):
    """Write a file of any processor after the user guide; points (frame, point, 3), words (frame, point)."""
    order = ">" if processor == 86 else "<"
    n_frames, n_points = words.shape
    group = struct.pack("bb", 5, -1) + b"POINT" + struct.pack(order + "H", 3) + b"\0"
    records = group + b"".join([
        parameter(1, "RATE", 4, [], floats([50.0], processor), order),
        parameter(1, "SCALE", 4, [], floats([scale], processor), order),
        parameter(1, "UNITS", -1, [2], b"mm", order),
        parameter(1, "Y_SCREEN", -1, [2], b"+Z", order),
        parameter(1, "LABELS", -1, [4, 2], b"a   b   ", order),
    ])  # fmt: skip
    section = (bytes([1, 80, 1, processor]) + records).ljust(512, b"\0")
    head = struct.pack("BB", 2, 80) + struct.pack(order + "5H", n_points, analog, 11, 10 + n_frames, 0)
    head += floats([scale], processor) + struct.pack(order + "2H", 3, 1) + floats([50.0], processor)
    step = 1.0 if scale < 0 else scale
    values = np.concatenate([points / step, words[..., None]], axis=-1).reshape(n_frames, -1)
    values = np.concatenate([values, np.full((n_frames, analog), 7.0)], axis=1)
    content = floats(values.ravel(), processor) if scale < 0 else np.round(values).astype(order + "i2").tobytes()
    path.write_bytes(head.ljust(512, b"\0") + section + content)
    return path


@pytest.mark.parametrize("processor", [84, 85, 86])
@pytest.mark.parametrize("scale", [-0.5, 0.5])
def test_integers_and_floats_of_any_processor(processor, scale, tmp_path):
    points = np.arange(24.0).reshape(4, 2, 3) * 10.0
    words = np.full((4, 2), 6.0 + 256 * 0b0000101)
    words[2, 1] = -1.0
    path = write_by_hand(tmp_path / "x.c3d", points, words, processor, scale, analog=3)
    actual = c3d_reading.read(path)
    expected = np.where((words < 0)[..., None], np.nan, points * 0.001)
    np.testing.assert_allclose(actual.points, expected, rtol=1e-6)
    np.testing.assert_allclose(actual.residual, np.where(words < 0, -1.0, 3.0))
    visible = np.zeros((4, 2, 7), dtype=bool)
    visible[words > 0] = [True, False, True, False, False, False, False]
    np.testing.assert_array_equal(actual.cameras, visible)
    assert (actual.names, actual.first, actual.rate_hz, actual.unit, actual.up) == (("a", "b"), 10, 50.0, "m", "z")


def test_ezc3d_cannot_read_mips_files(tmp_path):
    path = write_by_hand(tmp_path / "x.c3d", np.ones((4, 2, 3)), np.ones((4, 2)), 86, -0.5)
    assert c3d_reading.read(path).points.shape == (4, 2, 3)
    with pytest.raises(RuntimeError, match="MIPS"):
        ezc3d.c3d(str(path))


def test_ezc3d_finds_no_frames_in_files_with_analog_samples(tmp_path):
    path = write_by_hand(tmp_path / "x.c3d", np.ones((4, 2, 3)), np.ones((4, 2)), 84, -0.5, analog=3)
    assert c3d_reading.read(path).points.shape == (4, 2, 3)
    assert ezc3d.c3d(str(path))["data"]["points"].shape[2] == 0


def test_files_of_ezc3d(tmp_path):
    points = np.random.default_rng(0).normal(size=(3, 3, 20)) * 1000.0
    points[:, 1, 4] = np.nan
    stored = posefuse.read_points(write_with_ezc3d(tmp_path / "trial.c3d", points, first=7))
    np.testing.assert_allclose(stored.points_m[:, 0], points.transpose(2, 1, 0) * 0.001, rtol=1e-6)
    assert (stored.keypoints, stored.person_ids) == (("LASI", "S:RASI", "point_2"), ("trial",))
    assert (stored.rate_hz, stored.frame_numbers[0], stored.n_views) == (100.0, 7, None)
    unknown = posefuse.read_points(write_with_ezc3d(tmp_path / "trial.c3d", points, unit="furlong"))
    assert unknown.unit == ""
    np.testing.assert_allclose(unknown.points_m[:, 0], points.transpose(2, 1, 0), rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda data: data[:-600], "bytes of 20 frames"),
        (lambda data: b"\2\0" + data[2:], "readable format of 3D points|second byte"),
        (lambda data: data[:515] + b"\7" + data[516:], "unknown processor 7"),
        (lambda data: data[:300], "not a C3D file"),
    ],
)
def test_invalid_c3d_is_an_error(change, why, tmp_path):
    path = write_with_ezc3d(tmp_path / "x.c3d", np.ones((3, 3, 20)))
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(FileError, match=why):
        posefuse.read_points(path)


def refused(folder, cases):
    path = write_with_ezc3d(folder / "x.c3d", np.random.default_rng(0).normal(size=(3, 3, 20)))
    original, rng, n = path.read_bytes(), np.random.default_rng(9), 0
    for _ in range(cases):
        path.write_bytes(broken(original, rng))
        try:
            posefuse.read_points(path, "c3d")
        except PosefuseError:
            n += 1
    return n


def test_corrupt_files_are_errors(tmp_path):
    assert refused(tmp_path, 200) > 30


@pytest.mark.long
def test_many_corrupt_files(tmp_path):
    assert refused(tmp_path, 10_000) > 1500
