"""The recipe: matching views, cutting time, settling options, one camera, noise."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.errors import DetectionsError, MatchError, PosefuseWarning
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.view_names import plain_name
from posefuse.pipeline.reconstruct import reconstruct, triangulate
from posefuse.preprocess.match_cameras import match_views
from tests.scenes import body_points, ring, simulate_detections, skeleton_of


def named(rig: CameraRig, *names: str) -> CameraRig:
    return CameraRig(tuple(replace(c, name=name) for c, name in zip(rig.cameras, names, strict=True)))


def views(*names: str) -> Detections:
    return Detections.from_dense(skeleton_of(17), names, np.zeros((1, len(names), 17, 2)))


class TestMatching:
    def test_equal_names_in_any_order(self):
        rig, detections, notes = match_views(named(ring(3), "a", "b", "c"), views("c", "a"), Options())
        assert rig.names == ("c", "a") == detections.view_names
        assert notes == ("1 calibrated cameras have no view and are left out: b.",)

    def test_names_alike_but_for_punctuation_and_endings(self):
        rig, _, notes = match_views(named(ring(2), "cam_01", "cam_02"), views("cam02_json", "Cam01"), Options())
        assert rig.names == ("cam_02", "cam_01")
        assert "cam02_json = cam_02, Cam01 = cam_01" in notes[0]

    def test_never_by_position(self):
        with pytest.raises(
            MatchError, match=r"View '0' matches no camera by name.*Cameras: left, right.*--camera-order"
        ):
            match_views(named(ring(2), "left", "right"), views("0", "1"), Options())

    def test_by_camera_order(self):
        order = Options(camera_order=("right", "left"))
        rig, _, _ = match_views(named(ring(2), "left", "right"), views("0", "1"), order)
        assert rig.names == ("right", "left")

    @pytest.mark.parametrize("order", [("left",), ("left", "left"), ("left", "rihgt")])
    def test_an_order_must_name_each_once(self, order):
        with pytest.raises(MatchError, match="camera_order must name one|Did you mean 'right'"):
            match_views(named(ring(2), "left", "right"), views("0", "1"), Options(camera_order=order))

    def test_ambiguous_names(self):
        with pytest.raises(MatchError, match=r"View 'cam1' could be any of cam_1, Cam-1"):
            match_views(named(ring(2), "cam_1", "Cam-1"), views("cam1"), Options())

    def test_two_views_of_one_camera(self):
        with pytest.raises(MatchError, match="Views cam1, cam_1_json all match camera 'cam_1'"):
            match_views(named(ring(2), "cam_1", "cam_2"), views("cam1", "cam_1_json"), Options())

    def test_choosing_and_leaving_out(self):
        rig = named(ring(3), "a", "b", "c")
        chosen, detections, _ = match_views(rig, views("a", "b", "c"), Options(cameras=("c", "a")))
        assert chosen.names == ("c", "a") == detections.view_names
        chosen, detections, _ = match_views(rig, views("a", "b", "c"), Options(exclude_camera=("b",)))
        assert chosen.names == ("a", "c") == detections.view_names
        with pytest.raises(MatchError, match="No camera 'd'"):
            match_views(rig, views("a", "b", "c"), Options(exclude_camera=("d",)))
        with pytest.raises(MatchError, match="Camera 'c' is calibrated but has no view"):
            match_views(rig, views("a", "b"), Options(cameras=("c",)))
        with pytest.raises(MatchError, match="No camera is left"):
            match_views(
                rig,
                views(
                    "a",
                ),
                Options(exclude_camera=("a",)),
            )

    @pytest.mark.parametrize(
        ("name", "plain"), [("cam01_json", "cam01"), ("Cam-01_keypoints", "cam01"), ("c_keypoints_json", "c")]
    )
    def test_plain_names(self, name, plain):
        assert plain_name(name) == plain


class TestTime:
    def test_cut(self, rng):
        rig = ring(3)
        detections = simulate_detections(rig, body_points(rng, 20), rng, rate_hz=10.0)
        result = reconstruct(rig, detections, Options(start_s=0.5, end_s=1.0))
        assert result.frame_numbers.tolist() == [5, 6, 7, 8, 9]
        np.testing.assert_allclose(result.time_s, np.arange(5, 10) / 10)

    def test_nothing_left(self, rng):
        rig = ring(3)
        detections = simulate_detections(rig, body_points(rng, 20), rng, rate_hz=10.0)
        with pytest.raises(DetectionsError, match=r"No frame lies between.*runs from 0\.000 s to 1\.900 s"):
            reconstruct(rig, detections, Options(start_s=5.0))

    def test_times_must_be_known(self, rng):
        rig = ring(3)
        detections = simulate_detections(rig, body_points(rng, 2), rng, rate_hz=None)
        with pytest.raises(DetectionsError, match="Add --rate-hz"):
            reconstruct(rig, detections, Options(start_s=1.0))
        assert np.isnan(reconstruct(rig, detections).time_s).all()

    def test_no_frames(self, rng):
        rig = ring(3)
        with pytest.raises(DetectionsError, match="empty"):
            reconstruct(rig, simulate_detections(rig, body_points(rng, 2), rng).frames(0, 0))


class TestMinViews:
    def test_lowered_once_with_a_warning(self, rng):
        rig = ring(2)
        simply = Options(triangulation=TriangulationOptions(method="simple"))
        with pytest.warns(PosefuseWarning, match="min_views lowered from 3 to 2: the rig has 2 cameras") as said:
            result = reconstruct(rig, simulate_detections(rig, body_points(rng, 40), rng), simply)
        assert len(said) == 1
        assert (result.layers["measured"].status == PointStatus.TWO_VIEWS).all()
        assert result.resolved.triangulation.min_views == 2

    def test_default_is_the_methods(self, rng):
        rig = ring(3)
        simply = Options(triangulation=TriangulationOptions(method="simple"))
        detections = simulate_detections(rig, body_points(rng, 5), rng).views(rig.names[:2])
        with pytest.warns(PosefuseWarning, match="the rig has 2 cameras"):
            reconstruct(rig, detections, simply)
        result = reconstruct(rig, simulate_detections(rig, body_points(rng, 5), rng), simply)
        assert result.resolved.triangulation.min_views == 3
        assert reconstruct(rig, detections).resolved.triangulation.min_views == 2


class TestOneCamera:
    def test_flat(self, rng):
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

    def test_with_the_detectors_depth(self, rng):
        rig = ring(1)
        pixels = np.moveaxis(rig.project(body_points(rng, 4)), 0, 1)
        depth = rng.normal(size=(4, 1, 17))
        depth[2, 0, 3] = np.nan
        detections = Detections.from_dense(skeleton_of(17), rig.names, pixels, depth=depth)
        options = Options(triangulation=TriangulationOptions(flatten_single_view=False))
        layer = reconstruct(rig, detections, options).layers["measured"]
        np.testing.assert_array_equal(layer.points_m[:, 0, :, 2], depth[:, 0])
        assert layer.status[2, 0, 3] == PointStatus.NOT_SEEN

    def test_depth_must_be_there(self, rng):
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


def test_triangulate_measures(rng):
    rig = ring(3)
    detections = simulate_detections(rig, body_points(rng, 5), rng)
    measured = triangulate(rig, detections)
    assert list(measured.layers) == ["measured"]
    assert measured.layers["measured"] == reconstruct(rig, detections).layers["measured"]
    assert (measured.layers["measured"].source == Source.MEASURED).all()


@pytest.mark.parametrize(("factor", "unit"), [(1000.0, "m"), (0.1, None)])
def test_a_wrong_scale_is_reported(factor, unit, rng):
    from posefuse.synthetic.options import SceneOptions
    from posefuse.synthetic.scenes import simulate

    scene = simulate(SceneOptions(duration_s=2, cameras=4))
    cameras = []
    for camera in scene.rig.cameras:
        pose = np.array(camera.camera_from_world)
        pose[:3, 3] /= factor
        cameras.append(replace(camera, camera_from_world=pose))
    rig = CameraRig(tuple(cameras), meters_per_unit=0.001 if unit else 1.0)
    with pytest.warns(PosefuseWarning, match="The scale is wrong for this skeleton") as said:
        result = reconstruct(rig, scene.detections)
    assert len(said) == 1
    if unit:
        assert f"add --length-unit {unit}" in str(said[0].message)
    assert any("scale is wrong" in note for note in result.provenance.notes)
