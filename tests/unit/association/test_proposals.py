"""Proposals of people from single frames, for any order, rig and detector errors."""

from dataclasses import replace

import numpy as np
import pytest

from posefuse.association.proposals import propose
from posefuse.errors import DetectionsError, OptionsError
from posefuse.model.frames import Frame
from posefuse.model.options.association import AssociationOptions, RptOptions
from posefuse.skeleton.skeletons import find_skeleton
from tests.unit.association.single_frames import (
    GROUPS,
    detect,
    noise_of,
    people_rig,
    propose_in,
    separated_people,
)


class TestNothing:
    def test_no_detections_give_no_proposals(self):
        rig, truth = people_rig(), separated_people(2)
        frame, _ = detect(rig, truth)
        assert len(propose_in(frame, rig, free=np.zeros(len(frame.view), dtype=bool))) == 0
        assert len(propose_in(frame, rig, free=frame.view == 1)) == 0
        nobody = np.empty(0, dtype=np.int64)
        empty = Frame(np.empty((0, 17, 2)), np.empty((0, 17)), nobody, nobody, np.zeros(5), np.ones(5, dtype=bool))
        assert propose_in(empty, rig).points_m.shape == (0, 17, 3)

    def test_detections_without_keypoints_are_ignored(self):
        rig, truth = people_rig(), separated_people(1)
        frame, _ = detect(rig, truth)
        pixels = frame.keypoints_px.copy()
        pixels[1] = np.nan
        proposals = propose_in(replace(frame, keypoints_px=pixels), rig)
        assert proposals.rows.tolist() == [[0, -1, 2, 3, 4]]

    def test_arrays_of_another_size_are_refused(self):
        rig, truth = people_rig(), separated_people(1)
        frame, _ = detect(rig, truth)
        with pytest.raises(
            DetectionsError, match=r"has 5 detections in 5 views, but the rig has 5 cameras .* 3 entries"
        ):
            propose_in(frame, rig, free=np.ones(3, dtype=bool))
        with pytest.raises(DetectionsError, match="has 17 keypoints per person, but the skeleton 'body_25' has 25"):
            propose(rig, frame, noise_of(rig), find_skeleton("body_25"), np.ones(5, dtype=bool), GROUPS)


class TestOptions:
    @pytest.mark.parametrize(
        ("wrong", "message"),
        [
            ({"method": "best"}, "method must be one of groups, rpt, got 'best'"),
            ({"sigma_factor": 0.0}, "sigma_factor must be a finite number above 0, got 0"),
            ({"min_confidence": 2.0}, "min_confidence must be a finite number from 0 to 1"),
            ({"miss_log_odds": 1.0}, "miss_log_odds must be a finite number of at most 0"),
            ({"min_common": 0}, "min_common must be an integer of at least 1"),
            ({"outlier_share": 1.0}, "outlier_share must be a finite number between 0 and 1"),
            ({"full_weight_sigma": 5.0}, "full_weight_sigma must be below zero_weight_sigma"),
            ({"volume_m": (0.0, 0.0, 0.0, 1.0, -1.0, 1.0)}, "each minimum below its maximum"),
        ],
    )
    def test_invalid_options_are_refused(self, wrong, message):
        with pytest.raises(OptionsError, match=message):
            AssociationOptions(**wrong)

    def test_invalid_baseline_options_are_refused(self):
        with pytest.raises(OptionsError, match=r"rpt\.min_score must be a finite number from 0 to 1"):
            RptOptions(min_score=1.5)
        with pytest.raises(OptionsError, match=r"rpt\.merged_pairs must be an integer of at least 1"):
            RptOptions(merged_pairs=0)
