"""The tracker of a recording or of a live stream, from options."""

import warnings
from dataclasses import replace
from functools import partial

import numpy as np

from posefuse.errors import PosefuseWarning
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions
from posefuse.model.options.options import Options
from posefuse.model.options.tracker import TrackerOptions
from posefuse.pipeline.people.initial_noise import propose_people, proposed, sampled_frames
from posefuse.skeleton.skeletons import Skeleton
from posefuse.tracking.known_lengths import with_known_lengths
from posefuse.tracking.settings import TrackerSettings
from posefuse.tracking.tracker import ArticulatedTracker
from posefuse.tracking.unknown_bodies import measured_tree


def unused_options(options: Options, skeleton: Skeleton) -> tuple[str, ...]:
    """What is asked for that does nothing here, each with what would make it do something."""
    tracker, usual = options.tracker, TrackerOptions()
    said = []
    if tracker.strategy != "specification" and tracker.specification != usual.specification:
        said.append(
            "tracker.specification has options of the strategy 'specification', and the strategy is "
            f"{tracker.strategy!r}: they do nothing. Add --tracker.strategy specification, or leave them out."
        )
    if tracker.strategy == "specification" and tracker.smoother != "none":
        said.append(
            f"tracker.smoother = {tracker.smoother!r} does nothing with the strategy 'specification', whose states "
            "forget how well they are known: nothing is smoothed. Say --smoother none, or take the strategy 'posefuse'."
        )
    if tracker.parts != usual.parts and not skeleton.parts:
        said.append(
            f"tracker.parts has options of hands and faces, and skeleton {skeleton.name!r} has none that are followed: "
            "they do nothing. coco_wholebody_133 has them."
        )
    if tracker.lag_s != usual.lag_s and tracker.smoother != "lag":
        said.append(f"tracker.lag_s does nothing with the smoother {tracker.smoother!r}. Add --smoother lag.")
    if options.association.method != "rpt" and options.association.rpt != AssociationOptions().rpt:
        said.append(
            f"association.rpt has options of the method 'rpt', and the method is {options.association.method!r}: they "
            "do nothing. Add --association.method rpt, or leave them out."
        )
    return tuple(said)


def warn_of_unused_options(options: Options, skeleton: Skeleton) -> None:
    """Warn once of each option that does nothing here."""
    for remark in unused_options(options, skeleton):
        warnings.warn(remark, PosefuseWarning, stacklevel=3)


def tracker_of(rig: CameraRig, skeleton: Skeleton, noise: NoiseModel, options: Options) -> ArticulatedTracker:
    """A tracker that proposes people as the options say.

    Raises:
        OptionsError: if a length is known that bodies do not have.
        SkeletonError: if the skeleton has no tree.
    """
    skeleton = with_known_lengths(skeleton, options.tracker)
    settings = TrackerSettings.of(rig, skeleton, noise, options.tracker)
    return ArticulatedTracker(settings, partial(propose_people, rig, noise, skeleton, options))


def with_tree(rig: CameraRig, detections: Detections, noise: NoiseModel, options: Options) -> Skeleton:
    """The skeleton of the detections; one that does not say how its body moves gets the bones that a sample shows.

    Raises:
        SkeletonError: if the sample shows no bones.
    """
    skeleton = detections.skeleton
    if skeleton.tree is not None:
        return skeleton
    found = [proposed(rig, frame, noise, skeleton, options) for frame in sampled_frames(detections)]
    points = np.concatenate([each.points_m for each in found])
    covariance = np.concatenate([each.covariance_m2 for each in found])
    return replace(skeleton, tree=measured_tree(skeleton, points, covariance))
