"""A run from videos: the right result, nothing twice, and the same bytes from the project file."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import posefuse
from posefuse import Options, RunOptions
from posefuse.cli.explain import detections_for
from posefuse.errors import FileError, RecordingError
from posefuse.explain import explain
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.io.options import read_sync
from posefuse.model.options.calibration import PeopleOptions
from posefuse.pipeline.run.recipe import Watcher
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.coded_videos import FilmedPerson, film_person

OFFSETS_S, RATES_HZ = (0.0, 2.5, -1.0, 0.3), (25.0, 30.0, 25.0, 50.0)


@pytest.fixture(scope="module")
def phones(tmp_path_factory) -> tuple[Path, FilmedPerson]:
    """Videos that start seconds apart at different rates."""
    folder = tmp_path_factory.mktemp("phones")
    return folder, film_person(folder / "videos", offsets_s=OFFSETS_S, rates_hz=RATES_HZ)


def run(folder: Path, output: Path, person: FilmedPerson, choices=None, options=None):
    return posefuse.run(folder, output, choices, options, detector=person.detector, skeleton=person.skeleton)


def content_of(folder: Path) -> dict[str, bytes]:
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@pytest.fixture(scope="module")
def calibrated(phones, tmp_path_factory):
    """The output of a run with a calibration."""
    videos, person = phones
    folder = tmp_path_factory.mktemp("given")
    shutil.copytree(videos / "videos", folder / "videos")
    anipose.write(person.rig, folder / "calibration.toml")
    output = folder / "out"
    return folder, output, person, run(folder, output, person)


def test_phones_that_start_seconds_apart(calibrated):
    _, output, _, outcome = calibrated
    assert outcome.calibration is None
    sync = read_sync(output / "sync.toml")
    late = np.array([sync.offset_s[sync.cameras.index(f"cam_{v}")] if f"cam_{v}" in sync.cameras else 0.0
                     for v in range(4)])  # fmt: skip
    np.testing.assert_allclose(late - late[0], OFFSETS_S, atol=0.01)
    result = outcome.reconstruction.open()
    layer = result.best_layer()[1]
    assert np.nanmedian(layer.reprojection_error_px) < 1.0
    # The first and last seconds are those of one view.
    assert np.isfinite(layer.points_m[..., 0]).mean() > 0.65
    assert (output / "report.html").is_file()


def test_a_finished_run_is_not_repeated(calibrated):
    folder, output, person, _ = calibrated
    before = content_of(output)
    again = run(folder, output, person)
    assert again.kept == ("detect", "synchronize", "report")
    assert again.reconstruction.kept
    assert content_of(output) == before


def test_the_project_file_gives_the_same_bytes(calibrated, tmp_path):
    folder, output, person, _ = calibrated
    for name in ("videos", "calibration.toml"):
        source = folder / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, tmp_path / name)
    choices, options = posefuse.read_run(output / "posefuse.toml")
    run(tmp_path, tmp_path / "elsewhere", person, choices, options)
    found, before = content_of(tmp_path / "elsewhere"), content_of(output)
    assert found.keys() == before.keys()
    # The title of a report is the name of the folder.
    assert [name for name in found if found[name] != before[name] and not name.endswith("report.html")] == []


def test_only_what_an_option_changes_is_repeated(calibrated, tmp_path):
    folder, output, person, _ = calibrated
    assert not (output / "people.html").exists()
    copy = tmp_path / "out"
    shutil.copytree(output, copy)
    outcome = run(folder, copy, person, options=Options(people="one"))
    assert "detect" in outcome.kept
    assert not outcome.reconstruction.kept
    # Who was chosen can be seen.
    assert outcome.contact_sheet == copy / "people.html"
    assert "person_1" in outcome.contact_sheet.read_text()


def test_a_frame_of_views_that_started_seconds_apart_is_explained(calibrated):
    _, output, _, outcome = calibrated
    result = outcome.reconstruction.open()
    detections = detections_for(result, None, output / "keypoints", None)
    # The keypoints have fewer frames before the views are aligned.
    np.testing.assert_array_equal(detections.frame_numbers, result.frame_numbers)
    report = explain(result, 240, detections)
    assert report.complete
    assert {each.person for view in report.views for each in view.detections} == {"person_1"}


@pytest.mark.long
def test_cameras_are_calibrated_by_the_people(phones, tmp_path):
    videos, person = phones
    choices = RunOptions(by_people=PeopleOptions(stature_m=1.75))
    outcome = run(videos, tmp_path / "out", person, choices)
    assert not outcome.calibration.left_out
    assert (tmp_path / "out" / "calibration.html").is_file()
    result = outcome.reconstruction.open()
    assert np.nanmedian(result.best_layer()[1].reprojection_error_px) < 1.2
    turns = [c.rotation @ result.rig.cameras[0].rotation.T for c in result.rig.cameras]
    true = [c.rotation @ person.rig.cameras[0].rotation.T for c in person.rig.cameras]
    errors = [
        np.degrees(np.arccos(np.clip((np.trace(a @ b.T) - 1) / 2, -1, 1))) for a, b in zip(turns, true, strict=True)
    ]
    assert max(errors) < 2.0


def test_videos_without_people(phones, tmp_path):
    videos, person = phones
    with pytest.raises(RecordingError, match="no person in any of the 4 videos"):
        posefuse.run(videos, tmp_path / "a", detector=lambda image: None, skeleton=person.skeleton)

    def first_view(image):
        found = person.detector(image)
        return found if image[10, 250].mean() < 128 and image[10, 270].mean() < 128 else None

    with pytest.raises(RecordingError, match="in the video of 'cam_0' only"):
        posefuse.run(videos, tmp_path / "b", detector=first_view, skeleton=person.skeleton)


def test_the_same_video_twice(phones, tmp_path):
    videos, person = phones
    for name in ("a", "b"):
        shutil.copy(videos / "videos" / "cam_0.mp4", tmp_path / f"{name}.mp4")
    with pytest.raises(RecordingError, match=r"a\.mp4 and b\.mp4 are the same video"):
        run(tmp_path, tmp_path / "out", person)
    assert not (tmp_path / "out").exists()


def test_other_files_are_not_overwritten(phones, tmp_path):
    videos, person = phones
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(FileError, match="already contains other files"):
        run(videos, tmp_path, person)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["thesis.txt"]


@pytest.mark.long
@pytest.mark.parametrize("turned_deg", [0.0, 2.0])
def test_a_given_calibration_is_refined_where_that_helps(tmp_path, turned_deg):
    scene = simulate(SceneOptions(duration_s=6.0, cameras=4, seed=3))
    camera = scene.rig.cameras[1]
    pose = camera.camera_from_world.copy()
    pose[:3] = Rotation.from_euler("y", turned_deg, degrees=True).as_matrix() @ pose[:3]
    cameras = list(scene.rig.cameras)
    cameras[1] = replace(camera, camera_from_world=pose)
    anipose.write(replace(scene.rig, cameras=tuple(cameras)), tmp_path / "calibration.toml")
    native.write(scene.detections, tmp_path / "keypoints.nc")
    outcome = posefuse.run(tmp_path, tmp_path / "out", RunOptions(refine=True, synchronize="off"))
    refined = outcome.refinement
    assert refined.predicts_better == refined.is_better == (turned_deg > 0.0)
    # The verdict is that of refine-calibration.
    assert refined.findings is not None
    assert bool(refined.findings) == (turned_deg > 0.0)
    assert (tmp_path / "out" / "calibration.toml").is_file() == (turned_deg > 0.0)
    again = posefuse.run(tmp_path, tmp_path / "out", RunOptions(refine=True, synchronize="off"))
    assert again.kept == ("calibrate",)
    assert again.reconstruction.kept


def test_an_output_that_is_a_file_is_refused_before_the_plan(tmp_path):
    planned = []
    (tmp_path / "out").write_text("mine")
    with pytest.raises(FileError, match="is a file"):
        posefuse.run(tmp_path, tmp_path / "out", watcher=Watcher(planned.append))
    assert not planned
