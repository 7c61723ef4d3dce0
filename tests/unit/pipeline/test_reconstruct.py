"""The recipe: matching views, cutting time, settling options, one camera, noise."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import DetectionsError, PosefuseWarning
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.findings import FindingKind
from posefuse.model.options.alignment import AlignOptions
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.pipeline.reconstruct import reconstruct, triangulate
from tests.scenes import body_points, ring, simulate_detections, skeleton_of


class TestTime:
    def test_time_range_is_cut(self, rng):
        rig = ring(3)
        detections = simulate_detections(rig, body_points(rng, 20), rng, rate_hz=10.0)
        result = reconstruct(rig, detections, Options(start_s=0.5, end_s=1.0))
        assert result.frame_numbers.tolist() == [5, 6, 7, 8, 9]
        np.testing.assert_allclose(result.time_s, np.arange(5, 10) / 10)

    def test_empty_time_range_is_an_error(self, rng):
        rig = ring(3)
        detections = simulate_detections(rig, body_points(rng, 20), rng, rate_hz=10.0)
        with pytest.raises(
            DetectionsError, match=r"No frame lies from `start_s=5.0` on.*runs from 0\.000 s to 1\.900 s"
        ):
            reconstruct(rig, detections, Options(start_s=5.0))

    def test_time_range_needs_times(self, rng):
        rig = ring(3)
        detections = simulate_detections(rig, body_points(rng, 2), rng, rate_hz=None)
        with pytest.raises(DetectionsError, match="Add `rate_hz`"):
            reconstruct(rig, detections, Options(start_s=1.0))
        assert np.isnan(reconstruct(rig, detections).time_s).all()

    def test_recording_without_frames_is_an_error(self, rng):
        rig = ring(3)
        with pytest.raises(DetectionsError, match="empty"):
            reconstruct(rig, simulate_detections(rig, body_points(rng, 2), rng).frames(0, 0))


class TestMinViews:
    def test_min_views_is_lowered_once_with_a_warning(self, rng):
        rig = ring(2)
        simply = Options(triangulation=TriangulationOptions(method="simple"))
        with pytest.warns(PosefuseWarning, match="min_views lowered from 3 to 2: the rig has 2 cameras") as messages:
            result = reconstruct(rig, simulate_detections(rig, body_points(rng, 40), rng), simply)
        assert len(messages) == 1
        assert (result.layers["measured"].status == PointStatus.TWO_VIEWS).all()
        assert result.resolved.triangulation.min_views == 2

    def test_min_views_defaults_to_that_of_the_method(self, rng):
        rig = ring(3)
        simply = Options(triangulation=TriangulationOptions(method="simple"))
        detections = simulate_detections(rig, body_points(rng, 5), rng).views(rig.names[:2])
        with pytest.warns(PosefuseWarning, match="the rig has 2 cameras"):
            reconstruct(rig, detections, simply)
        result = reconstruct(rig, simulate_detections(rig, body_points(rng, 5), rng), simply)
        assert result.resolved.triangulation.min_views == 3
        assert reconstruct(rig, detections).resolved.triangulation.min_views == 2


class TestOneCamera:
    def test_result_is_in_the_image_plane(self, rng):
        rig = ring(1)
        detections = simulate_detections(rig, body_points(rng, 4), rng)
        result = reconstruct(rig, detections)
        layer = result.layers["measured"]
        pixels, _ = detections.dense()
        assert result.unit == "px"
        np.testing.assert_array_equal(layer.points_m[:, 0, :, :2], pixels[:, 0])
        assert (layer.points_m[..., 2] == 0).all()
        assert (layer.status == PointStatus.SINGLE_VIEW).all()
        assert np.isnan(layer.reprojection_error_px).all()

    def test_depth_of_the_detector_is_used(self, rng):
        rig = ring(1)
        pixels = rig.project(body_points(rng, 4))
        depth = rng.normal(size=(4, 1, 17))
        depth[2, 0, 3] = np.nan
        detections = Detections.from_dense(skeleton_of(17), rig.names, pixels, depth=depth)
        options = Options(triangulation=TriangulationOptions(flatten_single_view=False))
        layer = reconstruct(rig, detections, options).layers["measured"]
        np.testing.assert_array_equal(layer.points_m[:, 0, :, 2], depth[:, 0])
        assert layer.status[2, 0, 3] == PointStatus.NOT_SEEN

    def test_depth_must_be_available(self, rng):
        rig = ring(1)
        options = Options(triangulation=TriangulationOptions(flatten_single_view=False))
        with pytest.raises(DetectionsError, match="these keypoints have none"):
            reconstruct(rig, simulate_detections(rig, body_points(rng, 4), rng), options)

    def test_missing_and_low_confidence_keypoints(self, rng):
        rig = ring(1)
        detections = simulate_detections(rig, body_points(rng, 1), rng)
        pixels, confidence = (np.array(part) for part in detections.dense())
        pixels[0, 0, 2], confidence[0, 0, 5] = np.nan, 0.01
        layer = reconstruct(rig, Detections.from_dense(skeleton_of(17), rig.names, pixels, confidence)).layers[
            "measured"
        ]
        assert layer.status[0, 0, 2] == PointStatus.NOT_SEEN
        assert layer.status[0, 0, 5] == PointStatus.NOT_SEEN
        assert layer.view_status[0, 0, 5, 0] == ViewStatus.LOW_CONFIDENCE
        assert np.isnan(layer.points_m[0, 0, [2, 5]]).all()


def test_long_recordings_are_reconstructed_in_ranges(rng):
    rig = ring(3)
    detections = simulate_detections(rig, body_points(rng, 5000, 2), rng)
    whole = reconstruct(rig, detections)
    assert whole.n_frames == 5000
    part = reconstruct(rig, detections.frames(2040, 2060), Options(noise_scale_px=float(whole.noise.scale_px[0])))
    np.testing.assert_array_equal(whole.layers["measured"].points_m[2040:2060], part.layers["measured"].points_m)


def test_triangulate_returns_the_measured_layer(rng):
    rig = ring(3)
    detections = simulate_detections(rig, body_points(rng, 5), rng)
    measured = triangulate(rig, detections)
    assert list(measured.layers) == ["measured"]
    assert measured.layers["measured"] == reconstruct(rig, detections).layers["measured"]
    assert (measured.layers["measured"].source == Source.MEASURED).all()


def test_resized_world_has_the_notes_of_its_own_method_only():
    from posefuse.synthetic.options import SceneOptions
    from posefuse.synthetic.scenes import simulate

    scene = simulate(SceneOptions(duration_s=2, cameras=4))
    options = Options(
        bodies="fit",
        align=AlignOptions(height_m=1.5),
        triangulation=TriangulationOptions(method="percentile_filter"),
    )
    result = reconstruct(scene.rig, scene.detections, options)
    notes = [note for note in result.provenance.notes if note.startswith("percentile_filter")]
    threshold_px = result.resolved.triangulation.percentile_filter.threshold_px
    assert notes == [f"percentile_filter: percentile 90 of the errors is {threshold_px:.2f} px."]


@pytest.mark.parametrize(("factor", "unit"), [(1000.0, "m"), (0.1, None)])
def test_wrong_scale_is_reported(factor, unit, rng):
    from posefuse.synthetic.options import SceneOptions
    from posefuse.synthetic.scenes import simulate

    scene = simulate(SceneOptions(duration_s=2, cameras=4))
    cameras = []
    for camera in scene.rig.cameras:
        pose = np.array(camera.camera_from_world)
        pose[:3, 3] /= factor
        cameras.append(replace(camera, camera_from_world=pose))
    rig = CameraRig(tuple(cameras), meters_per_unit=0.001 if unit else 1.0)
    with pytest.warns(PosefuseWarning, match="The scale is wrong for this skeleton") as messages:
        result = reconstruct(rig, scene.detections)
    assert len(messages) == 1
    if unit:
        assert f"add `length_unit={unit!r}`" in str(messages[0].message)
    (finding,) = (each for each in result.findings if each.kind == FindingKind.SCALE)
    assert finding.is_certain
