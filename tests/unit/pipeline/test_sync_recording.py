"""Folders are synchronized by the sound of their videos to 5 ms, and by keypoints."""

import numpy as np
import pytest
from benchmarks.fault_scenes import healthy

from posefuse.errors import DetectionsError, MatchError
from posefuse.io.calibration import anipose
from posefuse.io.calibration.read import read_cameras
from posefuse.io.keypoints import native
from posefuse.io.keypoints.read import read_detections
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.pipeline.sync_recording import SyncRequest, sync_recording
from posefuse.synthetic.detector import add_errors
from posefuse.synthetic.figures import human
from posefuse.synthetic.options import CURRENT
from tests.sounds import Microphone, record, room_sound, write_sounding_video

STARTS_S = {"cam1": 3.0, "cam2": 6.217, "cam3": 10.041}


@pytest.fixture(scope="module")
def phones(tmp_path_factory):
    """Three phones that start seconds apart, with other frame rates, sampling clocks and sound that starts early."""
    folder = tmp_path_factory.mktemp("phones") / "videos"
    folder.mkdir()
    rng = np.random.default_rng(5)
    room = room_sound(35.0, rng)
    for i, ((name, start_s), rate_hz) in enumerate(zip(STARTS_S.items(), (30.0, 25.0, 59.94), strict=True)):
        lead_s = 0.02 * i
        samples = record(room, start_s - lead_s, 18.0, rng, Microphone(10.0, 15.0 * i))
        write_sounding_video(folder / f"{name}.mp4", samples, image_hz=rate_hz, sound_start_s=-lead_s)
    write_sounding_video(folder / "mute.mp4", None)
    return folder.parent


def test_offsets_of_phones_to_5_ms(phones):
    found = sync_recording(phones)
    measured = {each.view: each.offset_s for each in found.evidence}
    for name, start_s in STARTS_S.items():
        assert measured[name] == pytest.approx(start_s - STARTS_S["cam1"], abs=0.005)
    assert np.isnan(measured["mute"])
    assert found.sync.cameras == ("cam2", "cam3")


def test_reference_has_no_offset(phones):
    found = sync_recording(phones, SyncRequest(reference="cam2"))
    assert found.sync.offset_s == pytest.approx((-3.217, 3.824), abs=0.005)
    with pytest.raises(MatchError, match="no view 'cam9'"):
        sync_recording(phones, SyncRequest(reference="cam9"))


def test_videos_without_common_sound_are_one_sentence(phones, tmp_path):
    with pytest.raises(DetectionsError, match=r"mute has no sound track\."):
        sync_recording(phones, SyncRequest(videos={name: phones / "videos" / f"{name}.mp4" for name in ("mute",)} | {
            "cam1": phones / "videos" / "cam1.mp4"}, evidence="sound"))  # fmt: skip
    with pytest.raises(DetectionsError, match="There are no videos"):
        sync_recording(tmp_path, SyncRequest(evidence="sound"))
    with pytest.raises(DetectionsError, match="There is one video"):
        one = {"cam1": phones / "videos" / "cam1.mp4"}
        sync_recording(phones, SyncRequest(videos=one, evidence="sound"))


RATES_HZ = (30.0, 25.0, 29.97, 60.0)
LATE_S = (0.0, 3.217, 5.94, 1.303)


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """A calibrated recording of four phones with keypoints: other frame rates, starts seconds apart, with sound."""
    folder, rng, duration_s = tmp_path_factory.mktemp("walk"), np.random.default_rng(0), 14.0
    scene = healthy(3, cameras=4, duration_s=duration_s, rate_hz=30.0, activities=("walk", "turn"))
    figure, skeleton = human(scene.figure_m), scene.skeleton
    columns, room = figure.columns(skeleton), room_sound(25.0, rng)
    n_frames = round(max(RATES_HZ) * duration_s)
    recorded, time_s = np.zeros((n_frames, 4), dtype=bool), np.full((n_frames, 4), np.nan)
    pixels, confidence = np.empty((n_frames, 4, len(skeleton), 2)), np.empty((n_frames, 4, len(skeleton)))
    for v, (camera, rate_hz, late_s) in enumerate(zip(scene.rig.cameras, RATES_HZ, LATE_S, strict=True)):
        n = int(rate_hz * duration_s)
        recorded[:n, v], time_s[:n, v] = True, np.arange(n) / rate_hz
        points = scene.motion.positions(figure, time_s[:n, v] + late_s + 0.1)[:, columns]
        exact, size = camera.project(points)[0][:, None], np.array([camera.size_px])
        seen = add_errors(exact, size, skeleton, rate_hz, CURRENT, rng)
        pixels[:n, v], confidence[:n, v] = seen[0][:, 0], seen[1][:, 0]
        samples = record(room, 1.0 + late_s - 0.02 * v, duration_s, rng, Microphone(5.0, 20.0 * v))
        write_sounding_video(folder / f"{camera.name}.mp4", samples, image_hz=rate_hz, sound_start_s=-0.02 * v)
    offsets = np.concatenate([[0], np.cumsum(recorded.ravel())])
    detections = Detections(
        skeleton, scene.rig.names, np.arange(n_frames), time_s, offsets, pixels[recorded], confidence[recorded],
        recorded, np.full(offsets[-1], -1),
    )  # fmt: skip
    anipose.write(scene.given, folder / "calibration.toml")
    native.write(detections, folder / "keypoints.nc")
    return folder


def test_phones_of_different_rates_and_starts_are_synchronized_and_reconstructed(walk):
    found = sync_recording(walk, SyncRequest(options=Options(people="one")))
    assert found.contradictions == ()
    used = dict(zip(found.sync.cameras, found.sync.offset_s, strict=True))
    assert [used.get(f"cam_{v}", 0.0) for v in range(4)] == pytest.approx(LATE_S, abs=0.005)
    rig, detections = read_cameras(walk / "calibration.toml"), read_detections(walk / "keypoints.nc")
    options = Options(people="one", solve="frame", health="off", sync=found.sync)
    result = reconstruct(rig, detections, options)
    # The timeline reaches from the first to the last image; where the slowest view has none, it follows faster views.
    assert result.n_frames == pytest.approx(25.0 * (14.0 + LATE_S[2]), rel=0.03)
    assert np.nanmedian(result.layers["measured"].reprojection_error_px) < 8.0
