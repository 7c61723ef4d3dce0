"""One recipe for the command line, batches, clusters and Python."""

from dataclasses import asdict, replace
from html import escape

import numpy as np
import pytest

import posefuse
from posefuse import Options, RecordingInputs, SceneOptions
from posefuse.cli.simulate import write_scene
from posefuse.errors import DetectionsError, OptionsError, PosefuseWarning
from posefuse.io.files import CHECKPOINT_FOLDER
from posefuse.model.detections import Detections
from posefuse.model.findings import FindingKind
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.pipeline import reconstruct_recording as recipe

FRAMES_OFF = 3


@pytest.fixture(scope="module")
def scene():
    return posefuse.simulate(SceneOptions(duration_s=6.0, cameras=4, seed=4))


@pytest.fixture(scope="module")
def shifted_view(scene) -> Detections:
    """The scene's detections, with the third view three frames off."""
    pixels, confidence = scene.detections.dense()
    pixels[FRAMES_OFF:, 2], confidence[FRAMES_OFF:, 2] = pixels[:-FRAMES_OFF, 2], confidence[:-FRAMES_OFF, 2]
    detections = scene.detections
    return Detections.from_dense(
        detections.skeleton, detections.view_names, pixels, confidence, rate_hz=detections.rate_hz
    )


@pytest.fixture
def recording(scene, tmp_path):
    folder = tmp_path / "recording"
    folder.mkdir()
    write_scene(scene, folder)
    return folder


def test_python_reports_views_three_frames_apart(scene, shifted_view):
    result = posefuse.reconstruct(scene.rig, shifted_view, Options(solve="frame"))
    assert [(finding.kind, finding.cameras) for finding in result.findings] == [(FindingKind.TIME_OFFSET, ("cam_2",))]
    assert abs(result.findings[0].size) == pytest.approx(FRAMES_OFF, abs=0.5)
    assert posefuse.reconstruct(scene.rig, scene.detections, Options(solve="frame")).findings == ()


def test_findings_are_those_of_the_command_line_and_come_back_from_a_file(scene, shifted_view, tmp_path):
    folder = tmp_path / "recording"
    folder.mkdir()
    write_scene(replace(scene, detections=shifted_view), folder)
    outcome = posefuse.reconstruct_recording(folder, tmp_path / "out", Options(solve="frame"))
    result = posefuse.reconstruct(scene.rig, shifted_view, Options(solve="frame"))
    assert [each.kind for each in outcome.findings] == [each.kind for each in result.findings]
    assert outcome.open().findings == outcome.findings
    assert "Health" not in " ".join(outcome.notes)
    assert escape(outcome.findings[0].sentence) in (tmp_path / "out" / "report.html").read_text("utf-8")


def test_options_are_as_requested_and_the_resolved_ones_beside_them(recording, tmp_path):
    options = Options(triangulation=TriangulationOptions(method="simple"), chunk_frames=10**6)
    result = posefuse.reconstruct_recording(recording, tmp_path / "out", options).open()
    assert asdict(result.options) == asdict(options)
    assert (result.options.people, result.options.solve, result.options.triangulation.min_views) == (
        "auto",
        "auto",
        None,
    )
    assert (result.resolved.people, result.resolved.solve, result.resolved.pairs) == ("one", "frame", "labels")
    assert result.resolved.triangulation.min_views == 3
    assert result.resolved.chunk_frames < options.chunk_frames


def test_result_without_resolved_options_uses_the_requested_ones(scene):
    result = posefuse.Reconstruction(scene.rig, scene.truth.skeleton, ("a",), np.zeros(0), np.zeros(0), {
        "measured": scene.truth.layers["measured"].frames(0, 0)
    })  # fmt: skip
    assert result.resolved is result.options


def test_interruption_leaves_a_partial_result_that_resumes(recording, tmp_path, monkeypatch):
    options = Options(chunk_frames=60, solve="frame", pairs="labels")
    whole = posefuse.reconstruct_recording(recording, tmp_path / "whole", options)
    chunks = recipe.reconstruct_chunks

    def interrupted(*given):
        parts = chunks(*given)
        yield next(parts)
        yield next(parts)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(recipe, "reconstruct_chunks", interrupted)
        with pytest.warns(PosefuseWarning, match="finished chunks"):
            outcome = posefuse.reconstruct_recording(recording, tmp_path / "out", options)
    assert outcome.partial.startswith("Partial: made of the first 120 of 180 frames")
    assert outcome.open().n_frames == 120
    assert (tmp_path / "out" / CHECKPOINT_FOLDER).is_dir()
    resumed = posefuse.reconstruct_recording(recording, tmp_path / "out", options)
    assert resumed.partial == ""
    assert not (tmp_path / "out" / CHECKPOINT_FOLDER).exists()
    assert resumed.open() == whole.open()


def test_outcome_names_every_file(recording, tmp_path):
    inputs = RecordingInputs(calibration=recording / "calibration.toml")
    outcome = posefuse.reconstruct_recording(recording, tmp_path / "out", inputs=inputs, also=("npz",))
    assert {path.name for path in (tmp_path / "out").iterdir()} == set(outcome.files)
    assert outcome.output == tmp_path / "out"


def test_unknown_formats_and_missing_rates_are_refused_before_any_work(scene, tmp_path):
    with pytest.raises(OptionsError, match="no additional format"):
        posefuse.reconstruct_recording(tmp_path, tmp_path / "out", also=("xyz",))
    folder = tmp_path / "recording"
    folder.mkdir()
    timeless = replace(scene.detections, rate_hz=None, time_s=np.full_like(scene.detections.time_s, np.nan))
    write_scene(replace(scene, detections=timeless), folder)
    with pytest.raises(DetectionsError, match="`rate_hz"):
        posefuse.reconstruct_recording(folder, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_recording_is_inspected_by_its_folder(recording):
    assert posefuse.inspect_health(recording) == ()
    with pytest.raises(DetectionsError, match="needs detections"):
        posefuse.inspect_health(posefuse.read_cameras(recording / "calibration.toml"))
