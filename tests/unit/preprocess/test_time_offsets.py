"""Misaligned views are aligned, and no data is invented."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.association.one_subject import SingleSubject
from posefuse.errors import FileError, MatchError, OptionsError
from posefuse.io.options import options_to_toml, read_options, read_sync, sync_to_toml
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.options.sync import SyncOptions
from posefuse.preprocess.time_offsets import interpolate_to_frame_times, shift_views
from posefuse.skeleton.skeletons import find_skeleton

RATE = 25.0
SYNC = SyncOptions(("b",), (0.0,), (2.4 / RATE,), (0.0,))


def straight(late_frames: float = 2.4, frames: int = 40) -> Detections:
    """Two views of a point that moves 10 px a frame; the second view is late."""
    skeleton = find_skeleton("coco_17")
    taken = np.arange(frames)[:, None] + np.array([0.0, late_frames])
    pixels = np.full((frames, 2, len(skeleton), 2), 50.0)
    pixels[..., 0] = 10.0 * taken[..., None]
    return Detections.from_dense(skeleton, ("a", "b"), pixels, np.ones(pixels.shape[:3]), rate_hz=RATE)


def align(detections: Detections, sync: SyncOptions = SYNC) -> np.ndarray:
    step = shift_views(detections, ("a", "b"), sync)
    subject = SingleSubject.of(step.detections, None)
    return interpolate_to_frame_times(step, subject).dense()[0][..., 0, 0]


def test_keypoints_of_a_late_view_are_interpolated_to_frame_times():
    shown = align(straight())
    assert shown[3:-1, 1] == pytest.approx(shown[3:-1, 0])
    assert shown[:, 0] == pytest.approx(10.0 * np.arange(40))


def test_clock_drift_is_corrected():
    frames = np.arange(200)
    detections = straight(0.0, 200)
    pixels = detections.dense()[0].copy()
    pixels[:, 1, :, 0] = 10.0 * (frames * 1.01 + 1.0)[:, None]
    drifting = Detections.from_dense(detections.skeleton, ("a", "b"), pixels, rate_hz=RATE)
    shown = align(drifting, SyncOptions(("b",), (0.0,), (1.0 / RATE,), (1e4,)))
    reference = np.isfinite(shown[:, 1])
    assert reference.mean() > 0.95
    # Within a tenth of a frame, 1 px here, a view is left as it is.
    assert shown[reference, 1] == pytest.approx(shown[reference, 0], abs=1.001)


def test_gaps_of_more_than_two_frames_are_not_interpolated():
    detections = straight()
    pixels = detections.dense()[0].copy()
    pixels[20:23, 1] = np.nan
    gap = Detections.from_dense(detections.skeleton, ("a", "b"), pixels, rate_hz=RATE)
    shown = align(gap)
    # Frames 20 to 22 of the view were taken at 22.4 to 24.4, so that it has no data from 21.4 to 25.4.
    assert np.isnan(shown[22:26, 1]).all()
    assert np.isfinite(shown[[21, 26], 1]).all()


def test_view_without_offset_is_unchanged():
    detections = straight(0.0)
    shown = align(detections, SyncOptions(("b",), (0.0,), (0.05 / RATE,), (0.0,)))
    assert (shown == detections.dense()[0][..., 0, 0]).all()


DRIFTING, WHOLE = SyncOptions(("b",), (0.0,), (0.0,), (4e3,)), SyncOptions(("a",), (0.0,), (3.0 / RATE,), (0.0,))


@pytest.mark.parametrize("sync", [SYNC, DRIFTING, WHOLE])
def test_interpolated_views_are_marked(sync):
    detections = straight(0.0, 120)
    step = shift_views(detections, ("a", "b"), sync)
    subject = SingleSubject.of(step.detections, None)
    before, after = (
        step.detections.dense()[0][..., 0, 0],
        interpolate_to_frame_times(step, subject).dense()[0][..., 0, 0],
    )
    reference = np.isfinite(after)
    marked = sync.time_shifted(("a", "b"), step.time_s, 1.0 / RATE)
    assert (marked[reference] == (before != after)[reference]).all()


def test_offsets_of_a_view_apply_from_their_start_time():
    sync = SyncOptions(("b", "b"), (0.0, 1.0), (0.0, 0.12), (0.0, 0.0))
    assert sync.offset_at("b", np.array([-1.0, 0.5, 1.0, 2.0])) == pytest.approx([0.0, 0.0, 0.12, 0.12])
    assert (sync.offset_at("a", np.zeros(3)) == 0.0).all()


def test_files_of_offsets_round_trip(tmp_path):
    path = tmp_path / "sync.toml"
    path.write_text(sync_to_toml(SYNC), "utf-8")
    assert read_sync(path) == SYNC
    path.write_text(options_to_toml(replace(Options(), sync=SYNC)), "utf-8")
    assert read_options(path).sync == SYNC


@pytest.mark.parametrize("text", ["", "[noise]\nspread = 1.0\n", "[sync]\ncameras = ['a']\n", "[sync]\nlate = 3\n"])
def test_other_files_are_refused(tmp_path, text):
    path = tmp_path / "sync.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(OptionsError, match="sync"):
        read_sync(path)


def test_missing_files_and_cameras_are_errors(tmp_path):
    with pytest.raises(FileError):
        read_sync(tmp_path / "none.toml")
    with pytest.raises(MatchError, match="'c'"):
        shift_views(straight(), ("a", "b"), SyncOptions(("c",), (0.0,), (0.1,), (0.0,)))


def test_views_that_start_seconds_apart_keep_all_frames():
    detections = straight(2.4 + 50, 100)
    sync = SyncOptions(("b",), (0.0,), (52.4 / RATE,), (0.0,))
    step = shift_views(detections, ("a", "b"), sync)
    assert step.detections.n_frames == 152
    assert step.detections.recorded.sum(axis=0).tolist() == [100, 100]
    shown = interpolate_to_frame_times(step, SingleSubject.of(step.detections, None)).dense()[0][..., 0, 0]
    both = np.isfinite(shown).all(axis=1)
    assert both.sum() == 47
    assert shown[both, 1] == pytest.approx(shown[both, 0])
    assert sync.time_shifted(("a", "b"), step.time_s, 1.0 / RATE).all()
