"""The baseline of pairwise proposals."""

import numpy as np

from posefuse.model.options.association import AssociationOptions, RptOptions
from tests.unit.association.single_frames import (
    detect,
    people_of_proposals,
    people_rig,
    propose_in,
    separated_people,
)


class TestBaseline:
    def test_baseline_proposes_people_far_apart(self):
        rig, truth = people_rig(), separated_people(3)
        frame, owner = detect(rig, truth, sigma_px=2.0)
        proposals = propose_in(frame, rig, AssociationOptions(method="rpt", rpt=RptOptions(min_pairs=4)))
        assert sorted(people_of_proposals(proposals, owner), key=min) == [{0}, {1}, {2}]
        for rows, points in zip(proposals.rows, proposals.points_m, strict=True):
            assert np.nanmedian(np.linalg.norm(points - truth[owner[rows[0]]], axis=-1)) < 0.03

    def test_mean_of_pairs_is_less_accurate_than_one_solve(self):
        rig, truth = people_rig(), separated_people(3)
        errors = {"groups": [], "rpt": []}
        for seed in range(6):
            frame, owner = detect(rig, truth, seed=seed)
            for method, own in errors.items():
                actual = propose_in(frame, rig, AssociationOptions(method=method, rpt=RptOptions(min_pairs=4)))
                for rows, points in zip(actual.rows, actual.points_m, strict=True):
                    own.append(np.linalg.norm(points - truth[owner[rows[rows >= 0][0]]], axis=-1))
        assert np.nanmedian(errors["groups"]) < 0.95 * np.nanmedian(errors["rpt"])
