"""Proposal of people from the unassigned detections of one frame, by the chosen method."""

import numpy as np

from posefuse.association import groups, pairwise_baseline
from posefuse.errors import DetectionsError
from posefuse.model.cameras import CameraRig
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions
from posefuse.model.proposals import Proposals
from posefuse.skeleton.skeletons import Skeleton

_METHODS = {"groups": groups.propose, "rpt": pairwise_baseline.propose}


def propose(
    rig: CameraRig,
    frame: Frame,
    noise: NoiseModel,
    skeleton: Skeleton,
    free: np.ndarray,
    options: AssociationOptions,
    known_m: np.ndarray | None = None,
) -> Proposals:
    """Propose the people whom unassigned detections of a frame show in at least two views.

    Args:
        rig: Cameras, in the order of the frame's views.
        frame: The detections.
        noise: Noise model of the detections.
        skeleton: Skeleton of the keypoints; its core distinguishes people.
        free: shape (row,), bool: detections that are not assigned to a track.
        options: Options of the association.
        known_m: shape (person, keypoint, 3): people known from the last frame, NaN where missing; pairs of detections
            that contradict them are excluded.

    Raises:
        DetectionsError: If the frame does not fit the rig, the skeleton or `'free'`.
    """
    if len(free) != len(frame.view) or len(frame.recorded) != len(rig):
        raise DetectionsError(
            f"Frame {frame.number} has {len(frame.view)} detections in {len(frame.recorded)} views, but the rig has "
            f"{len(rig)} cameras and 'free' has {len(free)} entries. All three must come from the same recording."
        )
    views = frame.view[free]
    if len(views) < 2 or views[0] == views[-1]:
        return Proposals.none(len(skeleton), len(rig))
    if frame.keypoints_px.shape[1] != len(skeleton):
        raise DetectionsError(
            f"Frame {frame.number} has {frame.keypoints_px.shape[1]} keypoints per person, but the skeleton "
            f"{skeleton.name!r} has {len(skeleton)}. Use the skeleton of the detector."
        )
    return _METHODS[options.method](rig, frame, noise, skeleton, free, options, known_m).solvable()
