"""The verdict on a result is that of the recording check."""

import math
from dataclasses import replace

import numpy as np
import pytest

from posefuse.diagnostics.view_shifts import SHIFTED_VIEWS
from posefuse.model.findings import Finding, FindingKind, certain_faults, verdict_sentences
from posefuse.model.reconstruction import Provenance
from posefuse.model.status import USED_CODES, PointStatus
from posefuse.report.header import format_duration, verdict_box
from posefuse.report.summary import summarize
from posefuse.report.verdict import judge_result
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate


@pytest.fixture(scope="module")
def result():
    return simulate(SceneOptions(duration_s=0.5, cameras=3)).truth


def judge(result):
    return judge_result(result, summarize([result], result.best_layer()[0]))


def finding(kind: FindingKind, certainty: float) -> Finding:
    return Finding(
        kind, ("cam_1",), None, 3.0, "deg", math.nan, certainty, 10.0, f"Camera cam_1: {kind}.", "Calibrate again."
    )


@pytest.mark.parametrize("kind", FindingKind)
@pytest.mark.parametrize("certainty", [0.6, 0.99])
def test_verdict_is_poor_exactly_if_commands_exit_with_a_certain_fault(result, kind, certainty):
    findings = (finding(kind, certainty),)
    verdict = judge(replace(result, findings=findings))
    assert verdict.level == ("poor" if certain_faults(findings) else "check")
    assert findings[0].sentence in verdict.sentence
    assert verdict.remedy == findings[0].remedy


def test_certain_fault_is_named_although_another_finding_comes_first(result):
    findings = (finding(FindingKind.LOW_OVERLAP, 0.99), finding(FindingKind.COPIED_POSE, 0.99))
    verdict = judge(replace(result, findings=findings))
    assert "copied pose" in verdict.sentence
    assert "1 more finding below" in verdict.sentence


def test_good_result_repeats_the_sentence_of_the_commands(result):
    verdict = judge(result)
    assert verdict.level == "good"
    assert verdict.sentence.lower() == f"{verdict_sentences(())[0]}."


def noted(result, note):
    return replace(result, provenance=replace(result.provenance, notes=(note,)))


def test_views_that_do_not_agree_are_no_good_result(result):
    note = (
        "The views do not agree: 56 % of the detections contradict the other views. Either views are swapped, or not."
    )
    verdict = judge(noted(result, note))
    assert verdict.level == "check"
    assert verdict.sentence == "The views do not agree: 56 % of the detections contradict the other views."
    assert verdict.remedy == "Either views are swapped, or not."


def test_shifted_views_are_named_beside_the_verdict(result):
    note = f"{SHIFTED_VIEWS} from the projected 3D points: 21 px in cam_1. Test the poses."
    verdict = judge(noted(result, note))
    assert verdict.level == "good"
    assert verdict.sentence.endswith(
        " But all keypoints of these views are shifted in a common direction from the "
        "projected 3D points: 21 px in cam_1."
    )
    assert verdict.remedy == "Test the poses."


@pytest.mark.parametrize(("factor", "named"), [(1.5, False), (3.0, True)])
def test_a_camera_that_fits_far_worse_than_the_others_is_named(result, factor, named):
    name, layer = result.best_layer()
    errors = np.full(np.asarray(layer.view_error_px).shape, 4.0, dtype=np.float32)
    errors[..., 1] *= factor
    used = np.full(errors.shape, USED_CODES[0], dtype=np.int8)
    verdict = judge(replace(result, layers={name: replace(layer, view_error_px=errors, view_status=used)}))
    assert verdict.level == "good"
    assert ("fits worst" in verdict.sentence) == named
    assert (result.rig.names[1] in verdict.remedy) == named


def test_unchecked_results_are_not_good(result):
    off = replace(result, options=replace(result.options, health="off"))
    noted = replace(result, provenance=Provenance(notes=("Health: Camera 3 is turned.",)))
    assert judge(off).level == judge(noted).level == "check"
    assert "not checked" in judge(off).sentence


def test_result_without_points_is_poor(result):
    name, layer = result.best_layer()
    status = np.full(layer.status.shape, PointStatus.TOO_FEW_VIEWS, dtype=np.int8)
    empty = replace(layer, status=status, points_m=np.full(layer.points_m.shape, np.nan))
    assert judge(replace(result, layers={name: empty})).level == "poor"


def test_findings_are_escaped(result):
    hostile = replace(finding(FindingKind.CAMERA_POSE, 0.9), sentence="<img src=x>", remedy="</p><script>")
    box = verdict_box(judge(replace(result, findings=(hostile,))))
    assert "<img" not in box
    assert "<script" not in box


@pytest.mark.parametrize(("seconds", "text"), [(1.66, "1.7 s"), (600, "10 min"), (605.2, "10 min 5 s")])
def test_durations(seconds, text):
    assert format_duration(seconds) == text
