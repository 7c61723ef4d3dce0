"""``posefuse convert``: round trips and messages."""

import numpy as np
import pytest

from posefuse import read_cameras, read_detections
from posefuse.cli.main import main
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.files import qualisys_xml
from tests.keypoint_files import WRITERS

SCENE = simulate(SceneOptions(skeleton="coco_wholebody_133", duration_s=0.2, cameras=2))


@pytest.fixture
def records(tmp_path):
    return WRITERS["payload_lines"](SCENE.detections, tmp_path / "in")


def test_records_are_converted_to_replays_of_body_20(records, tmp_path, capsys):
    out = tmp_path / "replay.jsonl"
    main(["convert", str(records), str(out), "--onto", "body_20"])
    read = read_detections(out)
    assert read.skeleton.name == "body_20"
    detections = SCENE.detections.to_skeleton(read.skeleton)
    hip = read.skeleton.index("mid_hip")
    np.testing.assert_allclose(np.asarray(read.keypoints_px)[:, hip], np.asarray(detections.keypoints_px)[:, hip])
    output = capsys.readouterr().out
    assert "skeleton body_20" in output
    assert all(len(line) <= 80 for line in output.splitlines() if "/" not in line)


def test_every_written_format_converts_back(records, tmp_path):
    before = tmp_path / "start.nc"
    main(["convert", str(records), str(before)])
    places = [("a.csv", None), ("b.parquet", None), ("c.jsonl", None), ("d", "detection_tables"), ("e.nc", None)]
    for name, to in places:
        after = tmp_path / name
        main(["convert", str(before), "-o", str(after), *(["--to", to] if to else [])])
        before = after
    first, last = read_detections(tmp_path / "start.nc"), read_detections(before)
    assert last == first


def test_calibrations(tmp_path):
    (tmp_path / "Calib.qca.txt").write_text(qualisys_xml(SCENE.rig))
    main(["convert", str(tmp_path / "Calib.qca.txt"), str(tmp_path / "calibration.toml")])
    rig, original = read_cameras(tmp_path / "calibration.toml"), read_cameras(tmp_path / "Calib.qca.txt")
    for a, b in zip(rig.cameras, original.cameras, strict=True):
        np.testing.assert_allclose(a.camera_from_world, b.camera_from_world, atol=1e-9)


@pytest.mark.parametrize(
    ("output", "flags", "code", "message"),
    [
        ("x.xyz", [], 2, "Add --to"),
        ("x.csv", ["--to", "opnpose"], 2, "Did you mean 'openpose'"),
        ("x.toml", [], 2, "cannot write as anipose"),
        ("in/records.jsonl", [], 1, "is the input itself"),
        ("x.csv", ["--onto", "fly_38"], 2, "none of its keypoints can be derived"),
    ],
)
def test_invalid_arguments_have_a_remedy_and_write_nothing(records, tmp_path, capsys, output, flags, code, message):
    before = records.read_bytes()
    with pytest.raises(SystemExit) as stopped:
        main(["convert", str(records), str(tmp_path / output), *flags])
    assert stopped.value.code == code
    assert message in " ".join(capsys.readouterr().err.split())
    assert records.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["in"]
