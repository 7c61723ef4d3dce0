"""Statuses of points in every layer, after every step and in every file that holds them: each one is true."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import posefuse
from posefuse.errors import DetectionsError, OptionsError
from posefuse.evaluation.paired_results import only_in_states
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.edits import Drop, Split, Swap
from posefuse.model.layer_statuses import with_true_statuses
from posefuse.model.options.alignment import AlignOptions
from posefuse.model.options.options import Options
from posefuse.model.options.postprocess import Fill, Filter, PostprocessOptions
from posefuse.model.options.tracker import TrackerOptions
from posefuse.model.options.triangulation import METHODS, TriangulationOptions
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.status import PointStatus, Source, ViewStatus
from posefuse.model.tracks import TrackState
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from tests.properties import examples
from tests.statuses import assert_all_statuses_hold, assert_statuses_hold, violations

# Outliers, weak geometry and options without effect are what these recordings consist of.
pytestmark = pytest.mark.filterwarnings("ignore::posefuse.errors.PosefuseWarning")

RIGS = (2, 3, 5)


@cache
def walking(people: int, cameras: int) -> tuple[CameraRig, Detections]:
    """Return 24 frames of walking people."""
    options = CrowdOptions(people=people, cameras=cameras, duration_s=0.96, seed=people, skeleton="body_20")
    scene = simulate_crowd(options)
    return scene.rig, scene.detections


def damaged(rig: CameraRig, detections: Detections, damage: Mapping[str, Any]) -> tuple[CameraRig, Detections]:
    """Return a recording with missing keypoints and views, outliers, NaN confidences and adjacent cameras."""
    rng = np.random.default_rng(damage["seed"])
    pixels, confidence = np.array(detections.keypoints_px), np.array(detections.confidence)
    pixels[rng.random(pixels.shape[:2]) < damage["missing"]] = np.nan
    hit = rng.random(pixels.shape[:2]) < damage["outliers"]
    pixels[hit] += rng.normal(0.0, 80.0, (hit.sum(), 2))
    confidence[rng.random(confidence.shape) < damage["without_confidence"]] = np.nan
    recorded = np.array(detections.recorded)
    view_of_row = np.repeat(np.arange(detections.offsets.size - 1), np.diff(detections.offsets))
    hidden = rng.random(recorded.size) < damage["hidden_views"]
    pixels[hidden[view_of_row]] = np.nan
    if damage["adjacent"]:
        first = rig.cameras[0].camera_from_world
        moved = [first + 0.02 * v * np.eye(4)[:, 3] * np.eye(4)[0][:, None] for v in range(len(rig))]
        rig = replace(
            rig,
            cameras=tuple(
                replace(camera, camera_from_world=pose) for camera, pose in zip(rig.cameras, moved, strict=True)
            ),
        )
    return rig, replace(detections, keypoints_px=pixels, confidence=confidence)


shares = st.sampled_from([0.0, 0.1, 0.4])
recordings = st.fixed_dictionaries(
    {
        "seed": st.integers(0, 2**32 - 1), "people": st.integers(1, 2), "cameras": st.sampled_from(RIGS),
        "missing": shares, "outliers": shares, "without_confidence": shares, "hidden_views": shares,
        "adjacent": st.sampled_from([False, False, False, True]),
    }
)  # fmt: skip
steps = st.builds(
    PostprocessOptions, drop_beyond_px=st.sampled_from([None, 6.0]), drop_beyond_sd_m=st.sampled_from([None, 0.02]),
    fill=st.sampled_from(get_args(Fill)), max_gap_s=st.sampled_from([0.1, 0.5]), rigid_bones=st.booleans(),
    smooth=st.lists(st.sampled_from(get_args(Filter)), max_size=3, unique=True).map(tuple),
)  # fmt: skip
options = st.builds(
    Options, health=st.just("off"), people=st.sampled_from(["auto", "one", "many", "stills"]),
    bodies=st.sampled_from(["auto", "fit"]),
    pairs=st.sampled_from([None, "enumerate", "labels"]), solve=st.sampled_from(["auto", "trajectory"]),
    postprocess=steps, align=st.sampled_from([AlignOptions(), AlignOptions(height_m=1.7, origin_m=(1.0, 0.0, 0.0))]),
    triangulation=st.builds(TriangulationOptions, method=st.sampled_from(list(METHODS))),
    tracker=st.builds(
        TrackerOptions, strategy=st.sampled_from(["posefuse", "specification"]),
        smoother=st.sampled_from(["none", "lag", "full"]),
    ),
)  # fmt: skip


@given(recording=recordings, chosen=options)
@examples(12)
def test_statuses_hold_in_every_layer(recording, chosen):
    rig, detections = damaged(*walking(recording["people"], recording["cameras"]), recording)
    try:
        result = posefuse.reconstruct(rig, detections, chosen)
    except DetectionsError:  # nobody is seen well enough
        return
    except OptionsError:
        assert chosen.people == "stills"  # which excludes what needs motion
        return
    assert_all_statuses_hold(result)


@given(recording=recordings, flatten=st.booleans(), postprocess=steps)
@examples(5)
def test_statuses_hold_for_one_camera(recording, flatten, postprocess):
    rig, detections = damaged(*walking(1, 2), recording)
    detections = replace(detections, depth=np.array(detections.keypoints_px)[..., 0] - 900.0)
    triangulation = TriangulationOptions(flatten_single_view=flatten)
    chosen = Options(
        cameras=rig.names[:1], people="one", pick="largest", triangulation=triangulation, health="off",
        postprocess=replace(postprocess, rigid_bones=False),
    )  # fmt: skip
    assert_all_statuses_hold(posefuse.reconstruct(rig, detections, chosen))


@given(recording=recordings, strategy=st.sampled_from(["posefuse", "specification"]))
@examples(5)
def test_points_of_live_people_have_a_covariance(recording, strategy):
    rig, detections = damaged(*walking(recording["people"], recording["cameras"]), recording)
    tracker = posefuse.Tracker(rig, detections.skeleton, Options(tracker=TrackerOptions(strategy=strategy)))
    for f in range(detections.n_frames):
        for person in tracker.update(posefuse.Frame.of(detections, f)).people:
            has_point = np.isfinite(person.points_m)
            np.testing.assert_array_equal(has_point.any(axis=-1), has_point.all(axis=-1))
            np.testing.assert_array_equal(np.isfinite(person.covariance_m2).all(axis=-1), has_point.all(axis=-1))


@cache
def processed(people: int) -> Reconstruction:
    """Return a result with all layers, and points with most statuses."""
    damage = {"seed": 3, "missing": 0.3, "outliers": 0.1, "without_confidence": 0.1, "hidden_views": 0.3}
    rig, detections = damaged(*walking(people, 5), {**damage, "adjacent": False})
    chosen = Options(
        bodies="fit", health="off", solve="trajectory" if people == 1 else "frame",
        postprocess=PostprocessOptions(drop_beyond_px=6.0, fill="linear", smooth=("butterworth",)),
    )  # fmt: skip
    return posefuse.reconstruct(rig, detections, chosen)


FILES = {
    "csv": "points.csv",
    "parquet": "points.parquet",
    "movement": "points.nc",
    "nwb": "points.nwb",
    "deeplabcut": "points.h5",
    "sleap": "points_sleap.h5",
    "npz": "points.npz",
    "freemocap": "points",
}


@pytest.fixture(scope="module", params=[1, 2], ids=["one person", "two people"])
def stored(request, tmp_path_factory) -> Reconstruction:
    """Return a result that was written and is read again."""
    file = tmp_path_factory.mktemp("stored") / "reconstruction.nc"
    posefuse.write(processed(request.param), file)
    return posefuse.read_reconstruction(file)


@pytest.mark.parametrize("layer", ["measured", "solved", "model"])
def test_statuses_hold_in_stored_results(stored, layer):
    assert_statuses_hold(stored.layers[layer])


@pytest.mark.parametrize("layer", ["measured", "solved", "model"])
@pytest.mark.parametrize("form", FILES)
def test_statuses_hold_in_converted_results(stored, tmp_path, form, layer):
    chosen = replace(stored, options=replace(stored.options, layer=layer))
    found = 0
    for file in posefuse.write(chosen, tmp_path / FILES[form], form).files:
        points = posefuse.read_points(file, form)
        assert violations(points) == {}
        found += int(np.isfinite(points.points_m).all(axis=-1).sum())
    assert found == stored.layers[layer].has_point.sum()


@pytest.mark.parametrize(
    "edit", [Swap(("person_1", "person_2"), 8), Split("person_1", "person_3", 12), Drop("person_2", 4, 9)]
)
def test_statuses_hold_after_edits(edit):
    assert_all_statuses_hold(posefuse.apply_edits(processed(2), [edit]))


def test_statuses_hold_in_selected_states():
    result = processed(2)
    selected = only_in_states(result, [TrackState.ACTIVE])
    assert selected.layers["measured"].has_point.sum() < result.layers["measured"].has_point.sum()
    assert_all_statuses_hold(selected)


def test_model_states_how_many_views_support_a_point():
    layer = processed(2).layers["model"]
    found = set(np.unique(layer.status[layer.has_point]).tolist())
    assert found == {PointStatus.OK, PointStatus.TWO_VIEWS, PointStatus.HELD, PointStatus.FILLED}


def test_trajectory_keeps_the_warnings_of_the_measured_layer():
    damage = {"seed": 3, "missing": 0.1, "outliers": 0.0, "without_confidence": 0.0, "hidden_views": 0.0}
    rig, detections = damaged(*walking(1, 3), {**damage, "adjacent": True})
    result = posefuse.reconstruct(rig, detections, Options(health="off", solve="trajectory", pairs="labels"))
    weak = result.layers["measured"].status == PointStatus.WEAK_GEOMETRY
    solved = result.layers["solved"]
    kept = weak & solved.has_point & (solved.n_views > 1)
    assert kept.sum() > 20
    assert (solved.status[kept] == PointStatus.WEAK_GEOMETRY).all()


def test_dropped_and_filled_points_rest_on_no_view():
    layer = processed(2).layers["solved"]
    filled = layer.status == PointStatus.FILLED
    before = processed(2).layers["measured"].has_point
    assert (filled & before).any()
    assert not layer.n_views[filled].any()


def test_layer_with_contradictions_gets_true_statuses():
    status = np.array(
        [PointStatus.OK, PointStatus.OK, PointStatus.TWO_VIEWS, PointStatus.OUTLIER, PointStatus.AMBIGUOUS]
    )
    points, covariance = np.ones((5, 3)), np.ones((5, 6))
    points[0, 1], covariance[2] = np.nan, np.inf
    n_views = np.array([3, 2, 2, 3, 1])
    views = np.where(np.arange(3) < n_views[:, None], ViewStatus.USED, ViewStatus.OUTLIER)
    layer = Layer(
        points[None, None], covariance[None, None], status[None, None].astype(np.int8),
        np.full((1, 1, 5), Source.MEASURED, np.int8), np.ones((1, 1, 5)), views[None, None].astype(np.int8),
        np.ones((1, 1, 5, 3), np.float32),
    )  # fmt: skip
    assert len(violations(layer)) > 3
    repaired = with_true_statuses(layer)
    assert violations(repaired) == {}
    expected = [
        PointStatus.UNCERTAIN, PointStatus.TWO_VIEWS, PointStatus.UNCERTAIN, PointStatus.OUTLIER, PointStatus.HELD,
    ]  # fmt: skip
    assert repaired.status[0, 0].tolist() == expected
    assert with_true_statuses(repaired) == repaired
