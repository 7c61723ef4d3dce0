"""Every file that a command names in its output exists, and formats without a file are not named as written."""

import html
import re
from pathlib import Path

import numpy as np
import pytest

from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.io.results.registry import RESULTS
from posefuse.io.results.write import additional_names
from posefuse.model.detections import Detections
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd

FILE = re.compile(r"[\w./-]+\.(?:nc|csv|trc|c3d|bvh|glb|html|png|parquet|npz|h5|nwb|mot|osim|toml)\b")
ENDINGS = {"TRC": ".trc", "C3D": ".c3d", "BVH": ".bvh", "glTF": ".glb"}


def uneven(detections: Detections) -> Detections:
    """Return detections with times but without a constant rate."""
    times = np.array(detections.time_s)
    times[1::3] += 0.004
    return Detections(
        **{
            **{name: getattr(detections, name) for name in detections.__dataclass_fields__},
            "time_s": times,
            "rate_hz": None,
        }
    )


@pytest.fixture
def folder(request, tmp_path, clean_scene) -> Path:
    """Return a recording: all cameras, one without calibration, or without a constant frame rate."""
    folder = tmp_path / "in"
    folder.mkdir()
    detections = clean_scene.detections
    if request.param == "one":
        detections = detections.views(detections.view_names[:1])
    elif request.param == "people":
        crowd = simulate_crowd(CrowdOptions(people=2, cameras=3, duration_s=0.5, seed=1))
        anipose.write(crowd.rig, folder / "calibration.toml")
        detections = crowd.detections
    else:
        anipose.write(clean_scene.rig, folder / "calibration.toml")
    native.write(uneven(detections) if request.param == "uneven" else detections, folder / "keypoints.nc")
    return folder


def names_in_report(output: Path) -> list[str]:
    text = re.sub(r"(?s)<(script|style|pre).*?</\1>", "", (output / "report.html").read_text("utf-8"))
    return FILE.findall(html.unescape(re.sub(r"<[^>]+>", " ", text)))


def check_names(out: str, folder: Path, output: Path) -> None:
    text = " ".join(out.split())
    for name in [*FILE.findall(text), *(names_in_report(output) if output.exists() else ())]:
        assert any((place / name).exists() for place in (output, folder, Path("/"))), f"{name} does not exist"
    remark = re.search(r"([\w, 3]+) contains? the layer", text)
    for kind, ending in ENDINGS.items():
        if remark and kind in remark.group(1):
            assert list(output.rglob(f"*{ending}")), f"no {kind} was written"
    if list(output.glob("*.trc")):
        assert remark
        assert "TRC" in remark.group(1)


@pytest.mark.parametrize(
    ("folder", "options"),
    [
        ("all", ["--also", *additional_names()]),
        ("all", ["--bodies", "fit"]),
        ("people", ["--also", "nwb", "npz", "opensim"]),
        ("all", ["--cameras", "cam_0", "--also", "parquet", "nwb"]),
        ("one", []),
        ("one", ["--also", "movement", "sleap", "deeplabcut"]),
        ("uneven", []),
        ("uneven", ["--also", "opensim"]),
    ],
    indirect=["folder"],
)
def test_named_files_exist(folder, options, run, tmp_path):
    output = tmp_path / "out"
    code, out, err = run("reconstruct", "--verbose", folder, "--output", output, *options)
    assert (code, output.exists()) in ((0, True), (2, False)), err
    check_names(out, folder, output)
    if code == 2:
        assert "--also:" in err
        return
    written = {entry.name for entry in output.iterdir()}
    (listed,) = re.findall(r"Wrote (.*?) to /", " ".join(out.split()))
    assert set(listed.split(", ")) == written


@pytest.mark.parametrize("folder", ["one", "all"], indirect=True)
def test_converted_files_exist_or_nothing_is_left(folder, run, tmp_path):
    assert run("reconstruct", "--verbose", folder, "--output", tmp_path / "out")[0] == 0
    for form in RESULTS.written():
        target = tmp_path / form.name
        target.mkdir()
        name = form.additional_name or f"x{form.endings[0] if form.endings else ''}"
        code, out, err = run("convert", tmp_path / "out", target / name, "--to", form.name)
        written = {entry.name for entry in target.iterdir()}
        if code:
            assert err.startswith("error: ")
            assert (form.name, written) == (form.name, set())
        else:
            (listed,) = re.findall(r"Wrote (.*?) to /", " ".join(out.split()))
            assert (form.name, set(listed.split(", "))) == (form.name, written)


@pytest.mark.parametrize("form", ["freemocap", "anipose", "npz", "openpose", "opensim"])
@pytest.mark.parametrize("folder", ["one"], indirect=True)
def test_impossible_formats_are_refused_before_the_work(form, folder, run, tmp_path, monkeypatch):
    from posefuse.pipeline import reconstruct_recording

    def work(*_, **__):
        raise AssertionError("the work began")

    monkeypatch.setattr(reconstruct_recording, "prepare", work)
    code, _, err = run("reconstruct", "--verbose", folder, "--output", tmp_path / "out", "--also", form)
    assert code == 2
    assert f"--also: {form} needs 3D points" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("folder", ["uneven"], indirect=True)
def test_frames_at_irregular_times_give_no_trc(folder, run, tmp_path):
    code, out, _ = run("reconstruct", "--verbose", folder, "--output", tmp_path / "out")
    assert code == 0
    assert "A TRC or C3D file needs evenly spaced frames" in " ".join(out.split())
    assert (tmp_path / "out" / "keypoints.csv").is_file()
