"""Detections that show two people in close contact.

A detector takes two people who hug for one, with keypoints of either. The assignment gives each detection to one track.
If the keypoints of one limb or more are another track's, they are removed from the first one, and if that other track
has no detection in the view, it is updated by them.
"""

import numpy as np

from posefuse.kernels.records import Detections
from posefuse.kernels.tracking.records import SharedAssignment
from posefuse.kernels.tracking.shared_detections import SplitParameters, share_detections
from posefuse.model.frames import Frame
from posefuse.tracking.body_states import ProjectedBodies
from posefuse.tracking.settings import TrackerSettings


def share_between_tracks(
    frame: Frame,
    rows: np.ndarray,
    labels: np.ndarray,
    projected: ProjectedBodies,
    may_share: np.ndarray,
    settings: TrackerSettings,
) -> np.ndarray:
    """Split detections that show two tracked people.

    Args:
        frame: The detections.
        rows: shape (track, view): assigned detections, -1 for none.
        labels: shape (track, view, keypoint), updated in place: -1 for keypoints of another person.
        projected: Predicted bodies.
        may_share: shape (track,), bool: tracks that may receive keypoints.
        settings: Settings of the tracker.

    Returns:
        The detections that update each track, shape (track, view): the assigned and the shared ones.
    """
    s, o = settings, settings.options
    own = o.shared_detections
    split = SplitParameters(
        o.clutter_m, o.keypoint_evidence, o.independent_keypoints, own.distance_m, own.edge_evidence, own.min_evidence
    )
    shared = np.empty_like(rows)
    share_detections(
        projected.arrays, Detections(frame.keypoints_px, frame.confidence, frame.view), s.law, s.keypoint_graph,
        may_share, split, SharedAssignment(rows, labels, shared),
    )  # fmt: skip
    return shared
