"""Options without effect are reported with a remedy."""

from dataclasses import replace

import pytest

from posefuse.errors import PosefuseWarning
from posefuse.model.options.association import AssociationOptions, RptOptions
from posefuse.model.options.options import Options
from posefuse.model.options.specification import SpecificationOptions
from posefuse.model.options.tracker import PartOptions, TrackerOptions
from posefuse.pipeline.people.trackers import unused_options, warn_of_unused_options
from posefuse.pipeline.track_live import Tracker
from posefuse.skeleton.skeletons import shipped_skeleton
from posefuse.synthetic.rigs import build_rig

BODY, WHOLE = shipped_skeleton("body_20"), shipped_skeleton("coco_wholebody_133")
OF_SPECIFICATION = SpecificationOptions(promote_score=3.0)


@pytest.mark.parametrize(
    ("tracker", "remedy"),
    [
        (TrackerOptions(specification=OF_SPECIFICATION), "Add `tracker.strategy='specification'`"),
        (TrackerOptions(strategy="specification"), "Add `tracker.smoother='none'`"),
        (TrackerOptions(strategy="specification", smoother="lag"), "Add `tracker.smoother='none'`"),
        (TrackerOptions(parts=PartOptions(model_floor_m=0.01)), "such as coco_wholebody_133"),
        (TrackerOptions(lag_s=0.5), "Add `tracker.smoother='lag'`"),
    ],
)
def test_unused_options_are_named_with_a_remedy(tracker, remedy):
    (sentence,) = unused_options(Options(tracker=tracker), BODY)
    assert "no effect" in sentence
    assert remedy in sentence


@pytest.mark.parametrize(
    ("tracker", "skeleton"),
    [
        (TrackerOptions(), BODY),
        (TrackerOptions(strategy="specification", smoother="none", specification=OF_SPECIFICATION), BODY),
        (TrackerOptions(parts=PartOptions(model_floor_m=0.01)), WHOLE),
        (TrackerOptions(smoother="lag", lag_s=0.5), BODY),
    ],
)
def test_options_with_effect_are_not_named(tracker, skeleton):
    assert unused_options(Options(tracker=tracker), skeleton) == ()


def test_options_of_another_proposal_method_are_named():
    baseline = AssociationOptions(rpt=RptOptions(min_score=0.9))
    assert "`association.method='rpt'`" in unused_options(Options(association=baseline), BODY)[0]
    assert unused_options(Options(association=replace(baseline, method="rpt")), BODY) == ()


def test_another_proposal_method_is_named_where_pairs_are_proposed():
    tracker, baseline = TrackerOptions(strategy="specification", smoother="none"), AssociationOptions(method="rpt")
    (sentence,) = unused_options(Options(tracker=tracker, association=baseline), BODY)
    assert "`tracker.specification.pair_proposals=False`" in sentence
    groups = replace(tracker, specification=SpecificationOptions(pair_proposals=False))
    assert unused_options(Options(tracker=groups, association=baseline), BODY) == ()


def test_each_unused_option_is_a_warning_and_live_tracking_ignores_the_smoother():
    options = Options(tracker=TrackerOptions(parts=PartOptions(model_floor_m=0.01), lag_s=0.5))
    with pytest.warns(PosefuseWarning) as warned:
        warn_of_unused_options(options, BODY)
    assert len(warned) == 2
    with pytest.warns(PosefuseWarning) as warned:
        Tracker(build_rig("ring", 3), "body_20", options)
    assert len(warned) == 1
    Tracker(build_rig("ring", 3), "body_20", Options(tracker=TrackerOptions(smoother="lag", lag_s=0.5)))
