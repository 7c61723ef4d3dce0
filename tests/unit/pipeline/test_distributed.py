"""A recording reconstructed in pieces has the same people, and the same points where they have the same detections."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from posefuse.errors import FileError
from posefuse.io.checkpoints import CheckpointFolder
from posefuse.model.concatenate import concatenate_ranges
from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.model.options.alignment import AlignOptions
from posefuse.model.options.options import Options
from posefuse.model.options.postprocess import PostprocessOptions
from posefuse.model.options.tracking_stages import InitiationOptions
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
from posefuse.tracking.tracker import ArticulatedTracker


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


def without_frames(detections: Detections, first: int, last: int) -> Detections:
    """Return detections of which no view recorded the frames from ``first`` to ``last``, and later clocks are slow."""
    recorded, counts = np.array(detections.recorded), np.array(detections.people_counts)
    recorded[first:last] = False
    rows = np.flatnonzero(np.repeat(recorded.ravel(), counts.ravel()))
    time_s = np.where(recorded, detections.time_s, np.nan)
    time_s[last:] -= 0.3
    offsets = np.concatenate([[0], np.cumsum(np.where(recorded, counts, 0))])
    return replace(detections, recorded=recorded, time_s=time_s, offsets=offsets, **detections.rows(rows))


def without_people(detections: Detections, spans: Sequence[tuple[int, int]]) -> Detections:
    """Return detections without people in some frames, which all views recorded."""
    counts = np.array(detections.people_counts)
    shown = np.ones(counts.shape, dtype=bool)
    for start, stop in spans:
        shown[start:stop] = False
    rows = np.flatnonzero(np.repeat(shown.ravel(), counts.ravel()))
    offsets = np.concatenate([[0], np.cumsum(np.where(shown, counts, 0))])
    return replace(detections, offsets=offsets, **detections.rows(rows))


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


@pytest.mark.parametrize(("lost", "chunk", "initiation"), [
    # Lost before the wider range of the second window begins, and again after the border.
    ([(60, 75), (440, 455)], 400, InitiationOptions()),
    # Confirmed after more time than the history keeps frames open.
    ([(0, 430)], 64, InitiationOptions(min_age_s=7.0, max_age_s=9.0)),
])  # fmt: skip
def test_bodies_of_a_window_do_not_depend_on_the_frames_before(tmp_path, lost, chunk, initiation):
    scene = simulate_people(60.0, 1, 3, rate_hz=10.0)
    options = Options(people="many", solve="frame", noise_scale_px=14.0, pairs="labels", chunk_frames=chunk)
    options = replace(options, tracker=replace(options.tracker, initiation=initiation))
    scene = replace(scene, detections=without_people(scene.detections, lost))
    whole = reconstruct(scene.rig, scene.detections, options)
    check_same(whole, distributed(scene, options, tmp_path / "x", 0.1 * chunk))
    assert whole.person_ids
    assert len(list((tmp_path / "x").glob("tracker_*.part"))) > 1


def test_missing_result_of_a_worker_is_named(tmp_path):
    scene = simulate_people(4.0, 1, 3)

    def fails_to_store(work: Callable[[Path], None], pieces: Sequence[Path]) -> None:
        run_here(work, pieces)
        (pieces[-1].parent / "bodies_00000.part").unlink(missing_ok=True)

    with pytest.raises(FileError, match="The result bodies_00000 of a worker is missing in .* Run the same command"):
        distributed(scene, Options(people="many", noise_scale_px=14.0), tmp_path / "x", 4.0, fails_to_store)


def test_interrupted_tracking_promises_no_partial_result(tmp_path, monkeypatch):
    """Of a divided recording there is none, and the next run continues after the last chunk."""
    scene = simulate_people(9.0, 2, 3)
    options = Options(people="many", noise_scale_px=14.0, pairs="labels", chunk_frames=75)
    track_bodies, left = ArticulatedTracker.track_bodies, [100]

    def interrupted(tracker: ArticulatedTracker, frame: Frame) -> object:
        left[0] -= 1
        if not left[0]:
            raise KeyboardInterrupt
        return track_bodies(tracker, frame)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt), warnings.catch_warnings():
        patch.setattr(ArticulatedTracker, "track_bodies", interrupted)
        warnings.simplefilter("error")
        distributed(scene, options, tmp_path / "x", 4.5)
    check_same(reconstruct(scene.rig, scene.detections, options), distributed(scene, options, tmp_path / "x", 4.5))


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


def test_a_tracker_that_is_removed_before_bodies_are_smoothed_is_named(tmp_path):
    scene = simulate_people(6.0, 1, 3)
    options = Options(people="many", solve="frame", noise_scale_px=14.0, pairs="labels", chunk_frames=75)

    def removes(work: Callable[[Path], None], pieces: Sequence[Path]) -> None:
        run_here(work, pieces)
        for tracker in (tmp_path / "x").glob("tracker_*.part"):
            tracker.unlink()

    with pytest.raises(FileError, match=r"before frame 0, which was stored, is damaged .* Run the same command again"):
        distributed(scene, options, tmp_path / "x", 3.0, removes)
    expected = reconstruct(scene.rig, scene.detections, options)
    check_same(expected, distributed(scene, options, tmp_path / "x", 3.0))


@pytest.mark.parametrize("first", [740, 760])
def test_frames_that_no_view_recorded_have_the_same_times_in_a_window(tmp_path, first):
    """The window of frames 1500 to 1800 is tracked again from frame 750 on."""
    scene = simulate_people(72.0, 1, 3)
    detections = without_frames(scene.detections, first, first + 30)
    options = Options(people="many", solve="frame", noise_scale_px=14.0, pairs="labels", chunk_frames=1500)
    whole = reconstruct(scene.rig, detections, options)
    check_same(whole, distributed(replace(scene, detections=detections), options, tmp_path / "x", 36.0))


def test_tracking_without_bodies_resumes(tmp_path, monkeypatch):
    scene = simulate_people(6.0, 1, 3)
    options = Options(people="many", bodies="none", solve="frame", noise_scale_px=14.0, pairs="labels", chunk_frames=75)

    def ended(work: Callable[[Path], None], pieces: Sequence[Path]) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        distributed(scene, options, tmp_path / "x", 3.0, ended)
    monkeypatch.setattr("posefuse.pipeline.people.track_recording.first_tracker", None)
    assert distributed(scene, options, tmp_path / "x", 3.0).person_ids == ("person_1",)


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
