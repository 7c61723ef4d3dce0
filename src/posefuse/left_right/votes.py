"""Assign left and right by votes of the rays, for every pair and frame independently, as in the specification.

A vote is weighted by the detector's confidence times ``1 - |cos|`` of the angle between the ray and the line through
the two points: a view that sees them side by side is more reliable than one that sees one behind the other.
"""

import numpy as np

from posefuse.left_right.layout import Layout
from posefuse.left_right.results import PairSequence, SideAssignment
from posefuse.left_right.view_swaps import view_swap_states
from posefuse.model.options.left_right import SideOptions


def assign(sequence: PairSequence, options: SideOptions) -> SideAssignment:
    """Assign left and right for every pair of every frame; without votes, the order stays unchanged.

    Args:
        sequence: pairs and confidences.
        options: of the method.
    """
    layout = Layout.of(sequence.skeleton)
    flipped = sequence.by_frame(votes(sequence) < 0.0)
    return SideAssignment(flipped, view_swap_states(sequence, flipped, layout, options), layout.chains)


def votes(sequence: PairSequence) -> np.ndarray:
    """Return votes for the first point being the left one minus those for the second, shape (person_frame, pair)."""
    points, used = sequence.pairs.points_m, np.asarray(sequence.pairs.used)
    across = points[:, :, 1] - points[:, :, 0]
    across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-12)
    centers = np.array([camera.center_m for camera in sequence.rig.cameras])
    rays = points[:, :, None] - centers[:, None]
    rays = rays / np.maximum(np.linalg.norm(rays, axis=-1, keepdims=True), 1e-12)
    weight = 1.0 - np.abs(np.einsum("npvix,npx->npvi", rays, across))
    if sequence.confidence is not None:
        confidence = sequence.confidence.reshape(-1, *sequence.confidence.shape[2:])
        # A detector that gives no confidence trusts all its detections alike.
        confidence = np.where(np.isnan(confidence), 1.0, confidence)
        weight = weight * np.take_along_axis(confidence, np.maximum(used, 0).astype(np.int64), axis=3)
    sign = np.where(used == np.arange(2), 1.0, -1.0)
    total: np.ndarray = sign * np.where(used >= 0, np.nan_to_num(weight), 0.0)
    return total.sum(axis=(2, 3))
