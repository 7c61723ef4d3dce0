"""Timestamps of views: tables and folders, and their use by reconstruct."""

import re
from dataclasses import replace

import numpy as np
import pytest

from posefuse import Options, read_detections, reconstruct
from posefuse.cli.main import main
from posefuse.errors import DetectionsError, FileError, MatchError, PosefuseError, RecordingError
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.io.keypoints.request import Request
from posefuse.io.keypoints.timing import with_common_frames, with_timestamps
from posefuse.io.open_recording import RecordingInputs, open_recording
from posefuse.io.recording import choose_timestamps
from posefuse.io.timestamps import find, matches, read_timestamps
from posefuse.model.detections import Detections
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.broken import broken
from tests.files import write_openpose

SCENE = simulate(SceneOptions(skeleton="body_25", duration_s=1.0, rate_hz=60, cameras=3))


def table(path, header="camera,frame,time_s", rows=(("a", 0, 0.0), ("a", 1, 0.1), ("b", 0, 0.02), ("b", 1, 0.12))):
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


@pytest.mark.parametrize(
    ("header", "factor"),
    [("camera,frame,time_s", 1), ("port,sync_index,frame_time", 1), ("View, Frame_Index, Timestamp_ns", 1e9)],
)
def test_table(header, factor, tmp_path):
    rows = [("b", 1, 0.12 * factor), ("b", 0, 0.02 * factor), ("a", 0, 0.0), ("a", 1, 0.1 * factor)]
    timestamps = read_timestamps(table(tmp_path / "times.csv", header, rows))
    assert sorted(timestamps.by_view) == ["a", "b"]
    assert timestamps.by_view["b"].frames.tolist() == [0, 1]
    np.testing.assert_allclose(timestamps.by_view["b"].time_s, [0.02, 0.12])


@pytest.mark.parametrize(("unit", "factor"), [("seconds", 1), ("milliseconds", 1e3), ("nanoseconds", 1e9)])
def test_folder_of_arrays(unit, factor, tmp_path):
    folder = tmp_path / "timestamps"
    folder.mkdir()
    for name in ("Camera_0_synchronized", "Camera_1_synchronized"):
        np.save(folder / f"{name}_timestamps.npy", factor * np.arange(5) / 30)
    assert find([tmp_path]) == (folder.resolve(),)
    timestamps = read_timestamps(folder)
    assert list(timestamps.by_view) == ["Camera_0_synchronized", "Camera_1_synchronized"]
    np.testing.assert_allclose(timestamps.by_view["Camera_0_synchronized"].time_s, np.arange(5) / 30)
    assert unit in timestamps.notes[0]


def test_other_tables_are_not_timestamps(tmp_path):
    for header in ("frame,time_s,person,keypoint,x_m,y_m", "sync_index,port,frame_time,point_id,img_loc_x", "a,b"):
        assert not matches(table(tmp_path / "other.csv", header))
    assert matches(table(tmp_path / "times.csv"))
    assert [path.name for path in find([tmp_path])] == ["times.csv"]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([("a", 0, 0.0), ("a", 0, 0.1)], "contains frame 0 of a twice"),
        ([("a", 0, "soon")], "line 2: expected an integer frame number and a time, got 'a,0,soon'"),
        ([("a", 0.5, 1.0)], "line 2: expected an integer frame number"),
        ([], "contains no times, only a header"),
    ],
)
def test_invalid_tables_are_refused(rows, words, tmp_path):
    with pytest.raises(FileError, match=words):
        read_timestamps(table(tmp_path / "times.csv", rows=rows))
    with pytest.raises(FileError, match=r"expected the columns camera, frame and time_s"):
        read_timestamps(table(tmp_path / "other.csv", "camera,frame"))


def test_broken_timestamps_raise_posefuse_errors(tmp_path):
    rng = np.random.default_rng(3)
    rows = [(view, f, f / 30) for view in "ab" for f in range(20)]
    path = table(tmp_path / "times.csv", rows=rows)
    folder = tmp_path / "timestamps"
    folder.mkdir()
    for view in "ab":
        np.save(folder / f"{view}.npy", np.arange(20) / 30)
    refused = 0
    for file, whole in ((path, path), (folder / "a.npy", folder)):
        original = file.read_bytes()
        for _ in range(60):
            file.write_bytes(broken(original, rng))
            try:
                read_timestamps(whole)
            except PosefuseError:
                refused += 1
        file.write_bytes(original)
    assert refused > 30


def two_views(n: int = 4) -> Detections:
    return SCENE.detections.frames(0, n).views(SCENE.detections.view_names[:2])


def test_times_are_matched_to_views_by_name(tmp_path):
    names = two_views().view_names
    rows = [(name.upper(), f, 10 * v + f) for v, name in enumerate((*names, "another")) for f in range(4)]
    timestamps = with_timestamps(two_views(), read_timestamps(table(tmp_path / "times.csv", rows=rows)))
    np.testing.assert_array_equal(timestamps.time_s, [[f, 10 + f] for f in range(4)])
    assert timestamps.notes[-1] == "Times are read from times.csv, which has more views: ANOTHER."
    with pytest.raises(MatchError, match=f"no times for {names[1]}, only for {names[0].upper()}"):
        with_timestamps(two_views(), read_timestamps(table(tmp_path / "times.csv", rows=rows[:4])))
    short = [row for row in rows if row[1] != 2]
    with pytest.raises(DetectionsError, match="times are missing for 1 of 4 frames, the first of which is 2"):
        with_timestamps(two_views(), read_timestamps(table(tmp_path / "times.csv", rows=short)))
    unnumbered = [(name, t) for name, _, t in short]
    with pytest.raises(DetectionsError, match="expected a time for each of 4 frames, got 3"):
        with_timestamps(two_views(), read_timestamps(table(tmp_path / "times.csv", "camera,time_s", unnumbered)))


def test_views_can_have_their_own_rates():
    first, second = two_views().view_names
    timeless = replace(two_views(12), time_s=np.full((12, 2), np.nan), rate_hz=None)
    actual = with_common_frames(timeless, Request(rate_hz=30.0, view_rates_hz={second: 60.0}))
    assert (actual.n_frames, actual.rate_hz) == (12, 30.0)
    assert actual.recorded.sum(axis=0).tolist() == [12, 6]
    with pytest.raises(DetectionsError, match=f"sets no rate for {first}"):
        with_common_frames(timeless, Request(view_rates_hz={second: 60.0}))
    with pytest.raises(MatchError, match=r"view_rates_hz: unknown view 'cam_9'"):
        with_common_frames(timeless, Request(rate_hz=30.0, view_rates_hz={"cam_9": 60.0}))


def test_unequal_lengths_without_times_are_reported():
    cut = two_views(12)
    recorded = np.array(cut.recorded)
    recorded[9:, 1] = False
    counts = np.where(recorded, cut.people_counts, 0)
    keep = np.repeat(recorded.ravel(), cut.people_counts.ravel())
    shorter = replace(
        cut, recorded=recorded, offsets=np.concatenate([[0], np.cumsum(counts)]), time_s=np.full((12, 2), np.nan),
        rate_hz=None, keypoints_px=cut.keypoints_px[keep], confidence=cut.confidence[keep],
        track_ids=cut.track_ids[keep],
    )  # fmt: skip
    first, second = cut.view_names
    note = with_common_frames(shorter, Request()).notes[-1]
    assert re.search(rf"unequal numbers of frames \({first} 12, {second} 9\)", note)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Write three views at 60 Hz, and a copy whose second view is at 30 Hz, starts late and is numbered from 0."""
    folder = tmp_path_factory.mktemp("recording")
    anipose.write(SCENE.rig, folder / "calibration.toml")
    detections = SCENE.detections
    write_openpose(folder / "whole" / "pose", detections)
    write_openpose(folder / "mixed" / "pose", detections)
    name = f"{detections.view_names[1]}_json"
    files = sorted((folder / "mixed" / "pose" / name).iterdir())
    rows = [(view, f, f / 60) for view in (detections.view_names[0], detections.view_names[2]) for f in range(60)]
    for i, file in enumerate(files[10::2]):
        content = file.read_text()
        (file.parent / f"x_{i:012d}_keypoints.json").write_text(content)
        rows.append((detections.view_names[1], i, (10 + 2 * i) / 60))
    for file in files:
        file.unlink()
    table(folder / "mixed" / "times.csv", rows=rows)
    return folder


def reconstructed(recording, name, **options):
    """Read and reconstruct a recording like the command does."""
    options = Options(solve="frame", noise_scale_px=4.0, pairs="labels", **options)
    inputs = open_recording(recording / name, RecordingInputs(recording / "calibration.toml"), options)
    return reconstruct(inputs.rig, inputs.detections, options)


def test_mixed_rates_give_the_points_of_the_common_frames(recording):
    """The second view has half the rate and starts later."""
    whole = reconstructed(recording, "whole", rate_hz=60.0)
    mixed = reconstructed(recording, "mixed")
    assert mixed.rate_hz == 30
    notes = " ".join(mixed.provenance.notes)
    assert "Times are read from times.csv" in notes
    assert "30 of its 60 frames are not used" in notes
    names = SCENE.detections.view_names
    assert f"View {names[1]}_json (30 Hz): 5 of the 30 frames missing" in notes
    assert mixed.frame_numbers.tolist() == list(range(30))
    everywhere = np.asarray(whole.layers["measured"].points_m)[10::2]
    np.testing.assert_allclose(np.asarray(mixed.layers["measured"].points_m)[5:], everywhere, atol=1e-12)


def test_frame_numbers_that_agree_with_times_are_kept(tmp_path):
    """One view has every other frame. No frame is dropped, and the rate is that of the frame numbers."""
    first, second = two_views().view_names
    some = two_views(12)
    recorded = np.array(some.recorded)
    recorded[1::2, 1] = False
    kept = np.repeat(recorded.ravel(), some.people_counts.ravel())
    counts = np.where(recorded, some.people_counts, 0)
    holed = replace(
        some, recorded=recorded, offsets=np.concatenate([[0], np.cumsum(counts)]), time_s=np.full((12, 2), np.nan),
        rate_hz=None, keypoints_px=some.keypoints_px[kept], confidence=some.confidence[kept],
        track_ids=some.track_ids[kept],
    )  # fmt: skip
    rows = [(name, f, f / 60) for v, name in enumerate((first, second)) for f in range(0, 12, 1 + v)]
    timestamps = with_common_frames(
        holed, Request(timestamps=read_timestamps(table(tmp_path / "times.csv", rows=rows)))
    )
    assert (timestamps.n_frames, timestamps.rate_hz) == (12, 60.0)
    np.testing.assert_array_equal(timestamps.recorded, recorded)
    assert timestamps.notes[-1] == "Times are read from times.csv."


def test_several_timestamps_are_an_error(recording, capsys):
    other = table(recording / "mixed" / "other.csv")
    with pytest.raises(RecordingError, match=r"has 2 sets of timestamps. Choose one:\s+`timestamps=.*other.csv"):
        choose_timestamps(recording / "mixed", recording / "mixed" / "pose")
    other.unlink()
    with pytest.raises(SystemExit):
        main(["reconstruct", str(recording / "mixed"), "-o", str(recording / "out"), "--timestamps", str(other),
              "--calibration", str(recording / "calibration.toml")])  # fmt: skip
    assert "No timestamps at" in capsys.readouterr().err
    assert not (recording / "out").exists()


def test_times_in_the_keypoint_file_take_precedence_over_nearby_timestamps(tmp_path):
    native.write(two_views(), tmp_path / "keypoints.nc")
    stamps = read_timestamps(table(tmp_path / "times.csv"))
    detections = with_common_frames(read_detections(tmp_path / "keypoints.nc"), Request(nearby=stamps))
    np.testing.assert_array_equal(detections.time_s, two_views().time_s)
