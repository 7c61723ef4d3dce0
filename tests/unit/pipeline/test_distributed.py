"""A recording reconstructed in pieces has the same people, and the same points where they have the same detections."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from posefuse.io.checkpoints import CheckpointFolder
from posefuse.model.concatenate import concatenate_ranges
from posefuse.model.options.alignment import AlignOptions
from posefuse.model.options.options import Options
from posefuse.model.options.postprocess import PostprocessOptions
from posefuse.model.reconstruction import Reconstruction
from posefuse.pipeline.diagnose import check_recording
from posefuse.pipeline.distributed import (
    PieceRunner,
    RunPieces,
    Workers,
    is_long,
    prepare_distributed,
    reconstruct_distributed,
)
from posefuse.pipeline.joint_angles import with_joint_angles
from posefuse.pipeline.left_out_views import with_layer_scores
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.progress import Silent
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate


def run_here(work: Callable[[Path], None], pieces: Sequence[Path]) -> None:
    """Run pieces in reverse order: no piece depends on another."""
    for piece in reversed(pieces):
        work(piece)


def distributed(scene, options: Options, folder: Path, window_s: float, run: RunPieces = run_here) -> Reconstruction:
    runner = PieceRunner(CheckpointFolder(folder, "key"), Workers(run, window_s))
    plan = prepare_distributed(scene.rig, scene.detections, options, runner, Silent())
    plan = with_layer_scores(check_recording(plan))
    return with_joint_angles(
        concatenate_ranges(reconstruct_distributed(plan, runner, Silent()), plan.detections.n_frames)
    )


def simulate_people(seconds: float, people: int, seed: int, **more) -> CrowdScene:
    return simulate_crowd(CrowdOptions("crowd", people=people, cameras=4, duration_s=seconds, seed=seed, **more))


def check_same(whole: Reconstruction, pieces: Reconstruction) -> None:
    """Tracks, events, all layers and poses are bitwise equal."""
    assert pieces.person_ids == whole.person_ids
    assert pieces.events == whole.events
    assert whole.tracks is not None
    assert pieces.tracks is not None
    np.testing.assert_array_equal(pieces.tracks.state, whole.tracks.state)
    np.testing.assert_array_equal(pieces.tracks.detection, whole.tracks.detection)
    assert set(pieces.layers) == set(whole.layers)
    for layer in whole.layers:
        assert pieces.layers[layer] == whole.layers[layer]
    assert pieces.poses == whole.poses


def test_people_of_two_windows_equal_those_of_one_run(tmp_path):
    scene = simulate_people(9.0, 2, 3)
    options = Options(people="many", noise_scale_px=14.0, pairs="labels", chunk_frames=75)
    options = replace(options, tracker=replace(options.tracker, terminate_after_s=0.5))
    whole, pieces = reconstruct(scene.rig, scene.detections, options), distributed(scene, options, tmp_path / "x", 4.5)
    check_same(whole, pieces)
    assert any("in 2 windows" in note for note in pieces.provenance.notes)
    assert list((tmp_path / "x").glob("*.todo")) == []


@pytest.mark.long
def test_people_are_tracked_again_in_a_world_of_another_size(tmp_path):
    scene = simulate_people(9.0, 2, 3)
    options = Options(
        people="many", noise_scale_px=14.0, pairs="labels", align=AlignOptions(height_m=1.5), chunk_frames=75
    )
    options = replace(options, tracker=replace(options.tracker, terminate_after_s=0.5))
    whole, pieces = reconstruct(scene.rig, scene.detections, options), distributed(scene, options, tmp_path / "x", 4.5)
    check_same(whole, pieces)


def test_interrupted_run_resumes_from_finished_pieces(tmp_path):
    """Measured pieces are finished at the interruption; one is damaged before the run resumes."""
    scene = simulate(SceneOptions(duration_s=40.0, rate_hz=60.0, cameras=3, seed=2))
    options = Options(solve="frame", pairs="labels", postprocess=PostprocessOptions(smooth=("butterworth",)))
    whole = distributed(scene, options, tmp_path / "whole", 4.0)
    done: list[str] = []

    def ended(work: Callable[[Path], None], pieces: Sequence[Path]) -> None:
        run_here(work, pieces)
        raise KeyboardInterrupt

    def noted(work: Callable[[Path], None], pieces: Sequence[Path]) -> None:
        done.extend(piece.stem for piece in pieces)
        run_here(work, pieces)

    with pytest.raises(KeyboardInterrupt):
        distributed(scene, options, tmp_path / "x", 4.0, ended)
    damaged = tmp_path / "x" / "measured_00001.part"
    damaged.write_bytes(damaged.read_bytes()[:-1])
    assert distributed(scene, options, tmp_path / "x", 4.0, noted) == whole
    assert done[0] == "measured_00001"
    assert not any(name.startswith("measured") for name in done[1:])
    assert any(name.startswith("solved") for name in done)


def test_people_are_tracked_again_if_a_stored_tracker_is_damaged(tmp_path):
    scene = simulate_people(6.0, 1, 3)
    options = Options(people="many", solve="frame", noise_scale_px=14.0, pairs="labels", chunk_frames=75)
    whole = distributed(scene, options, tmp_path / "whole", 3.0)

    def ended(work: Callable[[Path], None], pieces: Sequence[Path]) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        distributed(scene, options, tmp_path / "x", 3.0, ended)
    (damaged,) = (tmp_path / "x").glob("tracker_*.part")
    damaged.write_bytes(damaged.read_bytes()[:-1])
    assert distributed(scene, options, tmp_path / "x", 3.0) == whole


@pytest.mark.long
@pytest.mark.parametrize("solve", ["frame", "trajectory"])
def test_crowd_of_three_windows_equals_one_run(tmp_path, solve):
    scene = simulate_people(120.0, 4, 1)
    options = Options(people="many", solve=solve, noise_scale_px=14.0, chunk_frames=500)
    options = replace(options, tracker=replace(options.tracker, terminate_after_s=5.0))
    whole, pieces = reconstruct(scene.rig, scene.detections, options), distributed(scene, options, tmp_path / "x", 40.0)
    check_same(whole, pieces)


@pytest.mark.long
def test_points_of_one_subject_are_bitwise_equal(tmp_path):
    scene = simulate(SceneOptions(duration_s=40.0, rate_hz=60.0, cameras=3, seed=2))
    options = Options(solve="frame", pairs="labels", postprocess=PostprocessOptions(smooth=("butterworth",)))
    whole, pieces = reconstruct(scene.rig, scene.detections, options), distributed(scene, options, tmp_path / "x", 4.0)
    assert pieces == whole


def test_recording_of_two_windows_is_long():
    scene = simulate(SceneOptions(duration_s=1.0, rate_hz=50.0, cameras=2))
    assert [is_long(scene.detections, Options(), window_s) for window_s in (0.4, 0.5, 0.6)] == [True, True, False]
