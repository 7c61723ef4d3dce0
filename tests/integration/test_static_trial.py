"""A result as static trial: it changes the angles, and a changed one is another input. Wide tables on request."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

import posefuse

FLAGS = ("--solve", "frame", "--end-s", "0.6")


def knee_angles(folder: Path) -> list[float]:
    with (folder / "angles_wide.csv").open(encoding="utf-8", newline="") as file:
        return [float(row["opensim_knee_angle_r_deg"]) for row in csv.DictReader(file)]


def test_a_changed_static_trial_is_another_input(run, recording, tmp_path):
    standing, out = tmp_path / "standing", tmp_path / "out"
    assert run("reconstruct", recording, "-o", standing, *FLAGS)[0] == 0
    command = ("reconstruct", recording, "-o", out, "--static", standing, "--also", "angles_wide", *FLAGS)
    code, _, warned = run(*command)
    assert code == 0, warned
    first = knee_angles(out)
    written = (out / "reconstruction.nc").stat().st_mtime_ns
    assert run(*command)[0] == 0
    assert (out / "reconstruction.nc").stat().st_mtime_ns == written
    trial = posefuse.read_reconstruction(standing / "reconstruction.nc")
    name, layer = trial.best_layer()
    points = np.array(layer.points_m)
    points[:, :, trial.skeleton.index("right_knee"), 1] += 0.05
    changed = replace(trial, layers={name: posefuse.Layer(*(
        points if field == "points_m" else np.asarray(getattr(layer, field)[:]) for field in layer.__dataclass_fields__
    ))})  # fmt: skip
    posefuse.write(changed.frames(0, changed.n_frames), tmp_path / "changed.nc")
    (tmp_path / "changed.nc").replace(standing / "reconstruction.nc")
    code, _, warned = run(*command)
    assert code == 1
    assert "other inputs, options or versions" in warned
    assert run(*command, "--overwrite")[0] == 0
    assert np.abs(np.subtract(knee_angles(out), first)).max() > 0.05
    assert run("convert", out, "-o", tmp_path / "angles_wide.csv")[0] == 0
    assert (tmp_path / "angles_wide.csv").read_bytes() == (out / "angles_wide.csv").read_bytes()
