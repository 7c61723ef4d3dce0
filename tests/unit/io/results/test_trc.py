"""TRC files."""

from dataclasses import replace

import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError, ResultError
from posefuse.io.results import trc
from posefuse.io.results.axes import y_up_from_world


class TestTrc:
    def test_independent_parser_finds_the_points(self, frame_result, tmp_path):
        path = tmp_path / "person.trc"
        posefuse.write(frame_result, path)
        lines = path.read_text().split("\n")
        assert lines[0] == "PathFileType\t4\t(X/Y/Z)\tperson.trc layer=measured"
        header = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
        assert header["DataRate"] == header["CameraRate"] == "60"
        assert (header["NumFrames"], header["NumMarkers"], header["Units"]) == ("9", "17", "m")
        assert lines[3].split("\t")[:6] == ["Frame#", "Time", "nose", "", "", "left_eye"]
        assert lines[4].split("\t")[2:6] == ["X1", "Y1", "Z1", "X2"]
        assert lines[5] == ""
        cells = [line.split("\t") for line in lines[6:] if line]
        assert {len(row) for row in cells} == {2 + 3 * 17}
        assert [row[0] for row in cells] == [str(i) for i in range(1, 10)]
        np.testing.assert_allclose([float(row[1]) for row in cells], np.arange(9) / 60, atol=1e-6)
        assert cells[3][2 + 15 : 2 + 18] == ["", "", ""]
        assert "nan" not in path.read_text()
        # y up: (x, y, z) of the file are (y, z, x) of a z-up world.
        x, y, z = frame_result.layers["measured"].points_m[4, 0, 9]
        np.testing.assert_allclose([float(cell) for cell in cells[4][2 + 27 : 2 + 30]], [y, z, x], atol=1e-6)

    def test_file_is_read_back(self, frame_result, tmp_path):
        posefuse.write(frame_result, tmp_path / "person.trc")
        actual = trc.read(tmp_path / "person.trc")
        assert actual.names == frame_result.skeleton.keypoints
        assert actual.rate_hz == 60.0
        expected = frame_result.layers["measured"].points_m[:, 0] @ y_up_from_world("z").T
        np.testing.assert_allclose(actual.points_m, expected, atol=5e-7)

    def test_unknown_up_axis_gives_no_rotation(self, frame_result, tmp_path):
        unknown = replace(frame_result, rig=replace(frame_result.rig, up_axis=None))
        posefuse.write(unknown, tmp_path / "person.trc")
        np.testing.assert_allclose(
            trc.read(tmp_path / "person.trc").points_m, frame_result.layers["measured"].points_m[:, 0], atol=5e-7
        )

    def test_missing_frames_are_empty_rows(self, frame_result, tmp_path):
        numbers = np.array([4, 5, 6, 9, 10, 11, 12, 13, 14])
        posefuse.write(replace(frame_result, frame_numbers=numbers), tmp_path / "person.trc")
        actual = trc.read(tmp_path / "person.trc")
        assert len(actual.points_m) == 11
        assert np.isnan(actual.points_m[3:5]).all()
        np.testing.assert_allclose(np.diff(actual.time_s), 1 / 60, atol=2e-6)

    def test_frame_rate_must_be_known_and_constant(self, frame_result, tmp_path):
        with pytest.raises(ResultError, match=r"needs a frame rate.*`rate_hz`"):
            posefuse.write(replace(frame_result, rate_hz=None, time_s=np.full(9, np.nan)), tmp_path / "person.trc")
        uneven = frame_result.time_s + np.array([0, 0, 0.01, 0, 0, 0, 0, 0, 0])
        with pytest.raises(ResultError, match="evenly spaced"):
            posefuse.write(replace(frame_result, rate_hz=None, time_s=uneven), tmp_path / "person.trc")
        posefuse.write(replace(frame_result, rate_hz=None), tmp_path / "person.trc")
        assert trc.read(tmp_path / "person.trc").rate_hz == pytest.approx(60.0)
        assert sorted(entry.name for entry in tmp_path.iterdir()) == ["person.trc"]

    @pytest.mark.parametrize(
        ("content", "words"),
        [
            ("hello", "not a TRC file"),
            ("PathFileType\n\n\n\n\n", "DataRate and Units"),
            (
                "PathFileType\nDataRate\tUnits\tNumFrames\n60\tm\t3\nFrame#\tTime\ta\n\t\tX1\n1\t0\t1\t2\t3\n",
                "has 1 rows, but its header declares 3 frames. Is it truncated",
            ),
            ("PathFileType\nDataRate\tUnits\n60\tm\nFrame#\tTime\ta\n\t\tX1\n1\t0\t1\tx\t3\n", "line 6.*neither"),
        ],
    )
    def test_broken_files(self, content, words, tmp_path):
        (tmp_path / "a.trc").write_text(content)
        with pytest.raises(FileError, match=words):
            trc.read(tmp_path / "a.trc")
