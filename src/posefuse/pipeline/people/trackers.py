"""Build the tracker of a recording or of a live stream from options."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from posefuse.association.pair_energy import propose_by_energy
from posefuse.errors import PosefuseWarning, SkeletonError
from posefuse.model.cameras import CameraRig
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.people.initial_noise import propose_from_all, propose_people
from posefuse.skeleton.skeletons import Skeleton
from posefuse.tracking.known_lengths import with_known_lengths
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.tracker import ArticulatedTracker
from posefuse.tracking.unknown_bodies import measured_tree

_EXPECTED_LOG_ODDS = 3.0
"""Log odds by which a lost person is expected more than a new one: few detections of an occluded body suffice."""
_MAX_VARIATION = 0.03
"""Largest relative variation of a distance that may connect parts of a body that no edge connects."""


def unused_options(options: Options, skeleton: Skeleton) -> tuple[str, ...]:
    """Return a sentence on each option that was set and has no effect, with what would give it one."""
    tracker, default = options.tracker, TrackerOptions()
    sentences = []
    if tracker.strategy != "specification" and tracker.specification != default.specification:
        sentences.append(
            "tracker.specification has options of the strategy 'specification', but the strategy is "
            f"{tracker.strategy!r}: they have no effect. Add `tracker.strategy='specification'`, or leave them out."
        )
    if tracker.strategy == "specification" and tracker.smoother != "none":
        sentences.append(
            f"tracker.smoother = {tracker.smoother!r} has no effect with the strategy 'specification', whose states "
            "have no covariances: nothing is smoothed. Add `tracker.smoother='none'`, or use the strategy 'posefuse'."
        )
    specified = tracker.strategy == "specification" and tracker.specification.pair_proposals
    if specified and options.association.method != "groups":
        sentences.append(
            f"association.method = {options.association.method!r} has no effect on new people with the strategy "
            "'specification', which proposes them from pairs. Add `tracker.specification.pair_proposals=False`, or "
            "leave it out."
        )
    if tracker.parts != default.parts and not skeleton.parts:
        sentences.append(
            f"tracker.parts has options of hands and faces, but skeleton {skeleton.name!r} has none to track: they "
            "have no effect. Use a skeleton with hands and a face, such as coco_wholebody_133."
        )
    if tracker.lag_s != default.lag_s and tracker.smoother != "lag":
        sentences.append(
            f"tracker.lag_s has no effect with the smoother {tracker.smoother!r}. Add `tracker.smoother='lag'`."
        )
    if options.association.method != "rpt" and options.association.rpt != AssociationOptions().rpt:
        sentences.append(
            f"association.rpt has options of the method 'rpt', but the method is {options.association.method!r}: they "
            "have no effect. Add `association.method='rpt'`, or leave them out."
        )
    return tuple(sentences)


def warn_of_unused_options(options: Options, skeleton: Skeleton) -> None:
    """Warn once of each option that was set and has no effect."""
    for sentence in unused_options(options, skeleton):
        warnings.warn(sentence, PosefuseWarning, stacklevel=3)


def tracker_of(rig: CameraRig, skeleton: Skeleton, noise: NoiseModel, options: Options) -> ArticulatedTracker:
    """Return a tracker that proposes people as the options specify.

    Raises:
        OptionsError: if a known length is of a bone, or a joint weight of a keypoint, that the skeleton does not have.
        SkeletonError: if the skeleton has no kinematic tree.
    """
    skeleton = with_known_lengths(skeleton, options.tracker)
    settings = TrackerSettings.of(rig, skeleton, noise, options.tracker)
    propose = partial(propose_people, rig, noise, skeleton, options)
    specification = settings.options.specification
    if options.tracker.strategy != "specification" or not specification.pair_proposals:
        association = options.association
        expected = replace(association, prior_log_odds=association.prior_log_odds + _EXPECTED_LOG_ODDS)
        propose_lost = partial(propose_people, rig, noise, skeleton, replace(options, association=expected))
        return ArticulatedTracker(settings, propose, propose_lost=propose_lost)
    propose_new = partial(propose_by_energy, rig, noise, skeleton, options.association, specification)
    return ArticulatedTracker(settings, propose, propose_new=propose_new)


def with_tree(
    rig: CameraRig, frames: Sequence[Frame], skeleton: Skeleton, noise: NoiseModel, options: Options
) -> Skeleton:
    """Return the skeleton with a kinematic tree; if it has none, measure one from a sample of frames.

    A tree that was built from edges alone covers one connected component of them. If there are several, the bones that
    connect them are measured too.

    Args:
        rig: calibrated cameras.
        frames: sample of frames.
        skeleton: skeleton of the keypoints.
        noise: noise of the detections.
        options: options of the reconstruction.

    Raises:
        SkeletonError: if the sample shows no bones.
    """
    tree = skeleton.tree
    disconnected = tree is not None and not tree.segments and bool(skeleton.unmodeled)
    if tree is not None and not disconnected:
        return skeleton
    found = [propose_from_all(rig, frame, noise, skeleton, options) for frame in frames]
    points = np.concatenate([each.points_m for each in found])
    covariance = np.concatenate([each.covariance_m2 for each in found])
    max_variation = np.inf if tree is None else _MAX_VARIATION
    try:
        return replace(skeleton, tree=measured_tree(skeleton, points, covariance, max_variation))
    except SkeletonError:
        if tree is None:
            raise
        return skeleton


def unmodeled_note(skeleton: Skeleton) -> tuple[str, ...]:
    """Return a note on the keypoints that the body model lacks although they have an edge."""
    missing = skeleton.unmodeled
    if not missing:
        return ()
    names = ", ".join(missing[:6]) + (", ..." if len(missing) > 6 else "")
    return (
        f"The body model has no node for {len(missing)} of {len(skeleton)} keypoints ({names}): no edge connects them "
        "to it. The layer measured holds them.",
    )
