"""The wide table of joint angles."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posefuse
from posefuse.errors import ResultError
from posefuse.io.results.angles_wide import FORMAT
from posefuse.model.joint_angles import ISB, OPENSIM, AngleStatus, JointAngles
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.skeletons import parse_skeleton

NAMES, CONVENTIONS = ("hip_flexion_r", "hip_flexion_r", "knee_angle_r"), (OPENSIM, ISB, OPENSIM)


def with_angles(result: Reconstruction) -> Reconstruction:
    """Return a result with angles, of which one is missing and the first person is absent in the second frame."""
    shape = (result.n_frames, len(result.person_ids), len(NAMES))
    degrees = np.arange(np.prod(shape), dtype=np.float32).reshape(shape) / 8.0
    status = np.zeros(shape, dtype=np.int8)
    status[1, 0] = AngleStatus.ABSENT
    status[0, 0, 2] = AngleStatus.NOT_OBSERVED
    degrees = np.where(status == AngleStatus.OK, degrees, np.nan)
    angles = JointAngles(NAMES, CONVENTIONS, "solved", degrees, degrees, status, np.zeros((*shape[:2], 3)))
    return replace(with_tree(result), joint_angles=angles)


def with_tree(result: Reconstruction) -> Reconstruction:
    """Return a result whose skeleton has a body model, and so may have joint angles."""
    own = result.skeleton
    edges = json.dumps([list(edge) for edge in own.edges])
    text = f'name = "own"\nkeypoints = {json.dumps(list(own.keypoints))}\nedges = {edges}\n[tree]\nsize_m = 1.0\n'
    return replace(result, skeleton=parse_skeleton(text, "own.toml"))


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_a_row_has_all_angles_of_a_person_in_a_frame(pair_result, tmp_path):
    result = with_angles(pair_result)
    done = posefuse.write(result, tmp_path / "angles_wide.csv")
    assert done.files == (tmp_path / "angles_wide.csv",)
    assert "standard deviations, statuses" in done.notes[-1]
    rows = rows_of(tmp_path / "angles_wide.csv")
    assert list(rows[0]) == [
        "frame", "time_s", "person", "opensim_hip_flexion_r_deg", "isb_hip_flexion_r_deg", "opensim_knee_angle_r_deg",
    ]  # fmt: skip
    people = len(result.person_ids)
    assert len(rows) == result.n_frames * people - 1
    assert rows[0]["opensim_knee_angle_r_deg"] == ""
    assert float(rows[0]["isb_hip_flexion_r_deg"]) == 0.125
    assert [row["person"] for row in rows[: 2 * people - 1]] == [*result.person_ids, *result.person_ids[1:]]
    last = np.asarray(result.joint_angles.degrees)[-1, -1]  # type: ignore[union-attr]
    assert [float(rows[-1][title]) for title in list(rows[-1])[3:]] == last.tolist()


def test_a_skeleton_without_angles_is_refused(pair_result, tmp_path):
    with pytest.raises(ResultError, match="chain has no joint angles"):
        posefuse.write(pair_result, tmp_path / "a.csv", FORMAT.name)
    assert not list(tmp_path.iterdir())


def test_a_result_made_without_angles_gives_no_rows(pair_result, tmp_path):
    posefuse.write(with_tree(pair_result), tmp_path / "a.csv", FORMAT.name)
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as file:
        assert list(csv.reader(file)) == [["frame", "time_s", "person"]]
