"""Time offsets of independently started cameras, from pairs and from all views."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.fault_scenes import Scene, healthy, plant

from posefuse.diagnostics.start_offsets import offsets_from_pairs
from posefuse.diagnostics.time_offsets import ViewTiming
from posefuse.errors import DetectionsError
from posefuse.model.findings import FindingKind
from posefuse.model.options.options import Options
from posefuse.model.options.sync import SyncOptions
from posefuse.pipeline.diagnose import inspect_health, judge_sync, measure_sync

RATE_HZ = 25.0


def with_offsets(scene: Scene, offsets: tuple[float, ...]) -> Scene:
    """Return the scene with each view late by the given number of frames."""
    for view, offset in enumerate(offsets):
        scene = plant(scene, "late", (view,), offset)[0] if offset else scene
    return scene


def judge(scene: Scene, sync: SyncOptions | None = None) -> tuple[tuple[ViewTiming, ...], SyncOptions, tuple]:
    """Return the timings of all views, the correction, and the findings, after an earlier correction."""
    rig, detections = scene.watch()
    return judge_sync(rig, detections, Options(sync=sync or SyncOptions()))


def test_offsets_from_pairs_prefer_the_best_pairs(rng):
    """A pair with a weak minimum at a wrong lag is ignored if other pairs connect both views."""
    truth, lags = np.array([0.0, 0.4, -0.2, 0.9]), 0.1 * np.arange(-15, 16)
    costs = np.full((4, 4, len(lags)), np.inf)
    for b in range(4):
        for a in range(b):
            costs[a, b] = np.minimum(np.abs(lags - (truth[b] - truth[a])), 0.5) + 0.01 * rng.random(len(lags))
    costs[0, 3] = 0.3 + 0.2 * np.abs(lags + 1.0)
    assert offsets_from_pairs(costs, lags) == pytest.approx(truth, abs=1e-9)


@pytest.mark.parametrize("offsets", [(0.0, -0.9, 1.4, 0.6, -1.5), (0.0, 21.0, -38.0, -14.0, 33.0)])
def test_all_offsets_are_measured_if_no_two_clocks_agree(offsets):
    scene = with_offsets(healthy(12, cameras=5, duration_s=20.0, rate_hz=RATE_HZ, activities=("walk",)), offsets)
    views, sync = measure_sync(*scene.watch(), reference=scene.rig.names[0])
    errors = [RATE_HZ * view.offset_s[0] - offset for view, offset in zip(views, offsets, strict=True)]
    assert np.abs(errors).max() < 0.2
    assert set(sync.cameras) == set(scene.rig.names[1:])


@pytest.mark.long
def test_unsynchronized_cameras_are_not_reported_as_moved():
    """Each of several offsets alone resembles a wrong pose; every clock but the common one is named and corrected."""
    offsets = (-1.4, -0.9, 0.0, 1.5, -0.6, 1.4)
    scene = with_offsets(healthy(1002, duration_s=60.0, rate_hz=RATE_HZ, activities=("walk",)), offsets)
    views, sync, findings = judge(scene)
    assert {finding.kind for finding in findings} <= {FindingKind.TIME_OFFSET, FindingKind.UNSYNCHRONIZED}
    named = {name for finding in findings for name in finding.cameras}
    assert named >= {"cam_0", "cam_3", "cam_5"}
    assert set(sync.cameras) == named
    assert len(named) >= 4
    left = np.array([o - RATE_HZ * v.offset_s[0] * v.is_corrected for o, v in zip(offsets, views, strict=True)])
    assert np.abs(left - np.median(left)).max() < 0.3
    _, again, findings = judge(scene, sync)
    assert again.does_nothing
    assert findings == ()


@pytest.mark.parametrize("seed", [6001, pytest.param(6003, marks=pytest.mark.long)])
def test_offsets_of_less_than_half_a_frame_are_corrected_for_free_running_cameras(seed):
    """None stands out, so that none is wrong on its own."""
    scene = healthy(seed, cameras=4, duration_s=30.0, rate_hz=RATE_HZ, activities=("walk",))
    offsets = (0.45, -0.4, 0.0, 0.35)
    scene = with_offsets(scene, offsets)
    views, sync, (finding,) = judge(scene)
    assert finding.kind is FindingKind.UNSYNCHRONIZED
    assert finding.cameras == sync.cameras
    left = np.array([o - RATE_HZ * v.offset_s[0] * v.is_corrected for o, v in zip(offsets, views, strict=True)])
    assert np.ptp(left) < 0.5 * np.ptp(offsets)
    assert judge(scene, sync)[2] == ()


def test_views_without_accepted_faults_have_a_standard_deviation():
    scene = with_offsets(healthy(2001, cameras=5, duration_s=20.0, rate_hz=RATE_HZ, activities=("walk",)), (0, 0, 10))
    late = [finding for finding in inspect_health(*scene.watch()) if finding.kind is FindingKind.TIME_OFFSET]
    assert late
    assert all(0.0 < finding.sd < 0.3 for finding in late)


def without_detections(scene: Scene, view: int, since: int = 0) -> Scene:
    """Return the scene with a view without detections from a frame on."""

    def hide(pixels: np.ndarray, confidence: np.ndarray, rng: object) -> tuple[np.ndarray, np.ndarray]:
        pixels[since:, view] = confidence[since:, view] = np.nan
        return pixels, confidence

    return replace(scene, after=(*scene.after, hide))


@pytest.mark.parametrize("seed", [0, 2, 12])
def test_offset_of_six_frames_between_two_cameras(seed):
    """The joint estimate alone, started without an offset, often ends at a false optimum of 3 to 5 frames."""
    scene = with_offsets(healthy(seed, cameras=2, duration_s=6.0, rate_hz=60.0, activities=("walk",)), (0.0, 6.0))
    (first, second), _ = measure_sync(*scene.watch())
    late_frames = 60.0 * (second.offset_s[0] - first.offset_s[0])
    sd_frames = 60.0 * max(first.offset_sd_s, second.offset_sd_s)
    assert late_frames == pytest.approx(6.0, abs=3.0 * sd_frames)
    assert sd_frames < 0.6


def test_view_without_agreement_keeps_offset_zero():
    lags = 0.1 * np.arange(-5, 6)
    costs = np.full((4, 4, len(lags)), np.inf)
    for a, b, late in ((0, 1, 0.2), (0, 2, 0.0), (1, 2, -0.2)):
        costs[a, b] = np.abs(lags - late)
    assert offsets_from_pairs(costs, lags) == pytest.approx([0.0, 0.2, 0.0, 0.0], abs=1e-9)


def test_synchronized_views_keep_their_times():
    """Offsets are relative to the clock that most views share, not to the mean over views."""
    scene = with_offsets(healthy(12, cameras=4, duration_s=15.0, rate_hz=RATE_HZ, activities=("walk",)), (0, 0, 2.3))
    views, sync = measure_sync(*scene.watch())
    assert set(sync.cameras) == {"cam_2"}
    assert RATE_HZ * views[2].offset_s[0] == pytest.approx(2.3, abs=0.2)


def test_view_without_detections_has_no_clock():
    scene = healthy(12, cameras=5, duration_s=15.0, rate_hz=RATE_HZ, activities=("walk",))
    views, sync = measure_sync(*without_detections(scene, 3).watch())
    assert [view.camera for view in views] == ["cam_0", "cam_1", "cam_2", "cam_4"]
    assert sync.does_nothing
    with pytest.raises(DetectionsError, match="do not agree well enough"):
        measure_sync(*without_detections(scene, 3).watch(), reference="cam_3")


def test_late_view_may_lose_its_detections():
    scene = with_offsets(healthy(12, cameras=5, duration_s=20.0, rate_hz=RATE_HZ, activities=("walk",)), (0, 0, 0, 2))
    (late,) = [
        f for f in inspect_health(*without_detections(scene, 3, 250).watch()) if f.kind is FindingKind.TIME_OFFSET
    ]
    assert late.cameras == ("cam_3",)
    assert late.size == pytest.approx(2.0, abs=0.3)


@pytest.mark.long
def test_dropped_frames_are_dated_by_the_timestamps_of_the_view():
    """A view 45 frames late drops 4 frames in the middle; the result uses its own timestamps."""
    scene = healthy(12, cameras=5, duration_s=40.0, rate_hz=RATE_HZ, activities=("walk",))
    scene, _ = plant(plant(scene, "late", (2,), 45)[0], "dropped", (2,), 4)
    begins = int(np.argmax(np.diff(scene.late_s[:, 2]) > 2.0 / RATE_HZ)) + 1
    views, _ = measure_sync(*scene.watch())
    jump = views[2]
    assert len(jump.start_s) == 2
    assert RATE_HZ * np.diff(jump.offset_s)[0] == pytest.approx(4.0, abs=0.5)
    # Accurate to about one second (25 frames).
    assert RATE_HZ * jump.start_s[1] == pytest.approx(begins, abs=30)
    (dropped,) = [f for f in inspect_health(*scene.watch()) if f.kind is FindingKind.DROPPED_FRAMES]
    assert dropped.frames is not None
    assert dropped.frames[0] == pytest.approx(begins, abs=30)
