"""Unrelated still frames: associated one by one, without tracking, and refused by what follows people over time."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import posefuse
from posefuse.cli.main import main
from posefuse.errors import DetectionsError, EditError, OptionsError, ResultError
from posefuse.evaluation.paired_results import people_points
from posefuse.evaluation.people import score_people
from posefuse.evaluation.self_consistency import self_consistency
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.io.results.rounding import rounded
from posefuse.model.detections import Detections
from posefuse.model.edits import Rename
from posefuse.model.options.options import Options
from posefuse.pipeline.defaults import RecordingFacts, resolve_options, resolve_people
from posefuse.pipeline.reconstruct import reconstruct
from tests.people import simulate_walkers
from tests.properties import examples

INTERVAL_S = 75.0
FAST = Options(people="stills", noise_scale_px=4.5, health="off")
WALKERS = simulate_walkers()


def stills(frames: list[int], interval_s: float = INTERVAL_S) -> Detections:
    """Return some frames of walking people, in this order, as if they were taken far apart."""
    detections, views = WALKERS.detections, WALKERS.detections.n_views
    starts = detections.offsets[np.array(frames)[:, None] * views + np.arange(views + 1)]
    rows = np.concatenate([np.arange(each[0], each[-1]) for each in starts])
    return replace(
        detections,
        frame_numbers=np.arange(len(frames)),
        time_s=np.tile(interval_s * np.arange(len(frames))[:, None], (1, views)),
        rate_hz=None if np.isnan(interval_s) else 1.0 / interval_s,
        recorded=np.asarray(detections.recorded)[frames],
        offsets=np.concatenate([[0], np.cumsum(np.diff(starts, axis=1))]),
        **detections.rows(rows),
    )


FRAMES = list(range(0, 50, 7))


@pytest.fixture(scope="module")
def result():
    return reconstruct(WALKERS.rig, stills(FRAMES), Options())


def test_frames_far_apart_are_stills_by_default(result):
    assert result.resolved.people == "stills"
    assert not result.has_identities
    assert set(result.layers) == {"measured"}
    assert result.poses is None
    assert result.events == ()
    notes = " ".join(result.provenance.notes)
    assert "Frames are 75 s apart, too far for tracking" in notes
    assert "`people='many'`" in notes


@pytest.mark.parametrize(("interval_s", "expected"), [(0.04, "many"), (2.0, "many"), (2.1, "stills"), (np.nan, "many")])
def test_auto_decides_by_the_time_between_frames(interval_s, expected):
    facts = RecordingFacts.of(stills(FRAMES, interval_s))
    assert resolve_people(Options(), facts, 4).people == expected
    assert resolve_people(Options(people="many"), facts, 4).people == "many"
    assert resolve_people(Options(pick="largest"), facts, 4).people == "one"


def test_people_are_found_in_every_frame(result):
    measured = np.asarray(WALKERS.truth.layers["measured"].points_m)[FRAMES]
    layers = {"measured": WALKERS.truth.layers["measured"].frames(0, len(FRAMES))}
    layers = {"measured": replace(layers["measured"], points_m=measured)}
    truth = replace(
        WALKERS.truth, frame_numbers=result.frame_numbers, time_s=result.time_s, layers=layers, tracks=None, swaps=None
    )
    scores = score_people(people_points(result, truth))
    assert scores.clear[0].recall > 0.95
    assert scores.clear[0].false_people <= 1
    assert scores.median_mm < 60.0


@given(st.permutations(FRAMES))
@examples(5)
def test_a_frame_does_not_depend_on_the_others(order):
    here, there = (reconstruct(WALKERS.rig, stills(frames), FAST) for frames in (FRAMES, order))
    for place, frame in enumerate(order):
        one, other = (each.layers["measured"].points_m for each in (here, there))
        np.testing.assert_array_equal(one[FRAMES.index(frame)], other[place])


def test_times_are_not_needed():
    without = replace(stills(FRAMES), rate_hz=None, time_s=np.full((len(FRAMES), WALKERS.detections.n_views), np.nan))
    timed, untimed = (reconstruct(WALKERS.rig, each, FAST) for each in (stills(FRAMES), without))
    np.testing.assert_array_equal(timed.layers["measured"].points_m, untimed.layers["measured"].points_m)


def test_an_empty_frame_and_no_people_at_all():
    empty = stills(FRAMES)
    nobody = replace(empty, offsets=np.zeros_like(empty.offsets), **empty.rows(np.zeros(0, dtype=np.int64)))
    with pytest.warns(posefuse.PosefuseWarning, match="No person"):
        found = reconstruct(WALKERS.rig, nobody, FAST)
    assert found.person_ids == ()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"bodies": "fit"}, "`bodies='fit'` needs consecutive frames"),
        ({"solve": "trajectory", "bodies": "fit"}, "`bodies='fit'` and `solve='trajectory'` need consecutive frames"),
        ({"postprocess": posefuse.PostprocessOptions(fill="linear")}, "`postprocess`"),
        ({"person": ("person_1",)}, "`person`"),
        ({"pick": "largest"}, "`pick`"),
        ({"align": posefuse.AlignOptions(floor="feet")}, "align.floor='feet'"),
        ({"align": posefuse.AlignOptions(forward="walk")}, "align.forward='walk'"),
    ],
)
def test_options_over_time_are_refused(change, says):
    with pytest.raises(OptionsError, match=says):
        reconstruct(WALKERS.rig, stills(FRAMES), replace(FAST, **change))


def test_one_camera_is_refused():
    with pytest.raises(OptionsError, match="two cameras"):
        resolve_options(FAST, RecordingFacts.of(stills(FRAMES)), 1)


def test_pairs_are_solved_frame_by_frame():
    facts = RecordingFacts.of(stills(FRAMES))
    assert resolve_options(FAST, facts, 4).pairs == "labels"
    assert resolve_options(replace(FAST, pairs="enumerate"), facts, 4).sides == "votes"


def test_files_are_those_of_a_few_names(tmp_path, result):
    folder = tmp_path / "recording"
    folder.mkdir()
    anipose.write(WALKERS.rig, folder / "calibration.toml")
    native.write(stills(FRAMES), folder / "keypoints.nc")
    outcome = posefuse.reconstruct_recording(folder, tmp_path / "out", FAST)
    assert set(outcome.files) == {"fingerprint.json", "keypoints.csv", "reconstruction.nc", "report.html"}
    assert {path.name for path in outcome.output.iterdir()} == set(outcome.files)
    page = (outcome.output / "report.html").read_text("utf-8")
    assert "numbers of people are not identities" in page
    assert not outcome.open().has_identities
    with pytest.raises(OptionsError, match="`also`: The format opensim follows each person over time"):
        posefuse.reconstruct_recording(folder, tmp_path / "other", Options(), also=("opensim",))
    assert not (tmp_path / "other").exists()


def test_formats_of_people_over_time_are_refused(tmp_path, result):
    for name in ("trc", "c3d", "bvh", "gltf", "movement", "opensim", "anipose", "npz"):
        with pytest.raises(ResultError, match="follows each person over time"):
            posefuse.write(result, tmp_path / f"file_{name}", name)
    for name in ("points.csv", "points.parquet", "result.nc"):
        assert posefuse.write(result, tmp_path / name).files
    assert posefuse.read_reconstruction(tmp_path / "result.nc") == rounded(result)
    assert json.dumps([path.name for path in tmp_path.iterdir()]).count("file_") == 0


def test_stages_that_follow_people_are_refused(result):
    with pytest.raises(EditError, match="unrelated"):
        posefuse.apply_edits(result, [Rename("person_1", "Ada")])
    with pytest.raises(ResultError, match="unrelated"):
        self_consistency(result)
    for stage in (posefuse.inspect_health, posefuse.measure_sync):
        with pytest.raises(DetectionsError, match="unrelated"):
            stage(WALKERS.rig, stills(FRAMES))


def test_methods_can_be_compared():
    compared = posefuse.compare_methods(WALKERS.rig, stills(FRAMES), ("consensus", "simple"), timed=False)
    assert [each.method for each in compared.methods] == ["consensus", "simple"]


def test_evaluation_reports_no_identities(tmp_path, capsys):
    truth = WALKERS.truth
    one = reconstruct(WALKERS.rig, WALKERS.detections, FAST)
    for path, each in (("result.nc", one), ("truth.nc", truth)):
        posefuse.write(each, tmp_path / path)
    main(["evaluate", str(tmp_path / "result.nc"), str(tmp_path / "truth.nc"), "--json", str(tmp_path / "scores.json")])
    output = capsys.readouterr().out
    assert "recall" in output
    assert "scores of identities and motion are" in output
    numbers = json.loads((tmp_path / "scores.json").read_text())
    assert numbers["clear"][0]["recall"] > 0.9
    assert {"identity", "hota", "jitter", "people"} & set(numbers) == set()
    assert "IDF1" not in output
    assert "switches" not in output
