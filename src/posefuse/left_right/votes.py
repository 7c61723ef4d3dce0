"""Each ray votes for the point it is near, as the specification has it: every pair and frame by itself, no memory.

A vote counts the detector's confidence times ``1 - |cos|`` of the angle between the ray and the line through the two
points: a view that sees them side by side knows better than one that sees one behind the other.
"""

import numpy as np

from posefuse.left_right.layout import Layout
from posefuse.left_right.results import PairsInTime, Sides
from posefuse.left_right.view_swaps import views_of
from posefuse.model.options.left_right import SideOptions


def decide(given: PairsInTime, options: SideOptions) -> Sides:
    """Decide every pair of every frame; without votes, the order stays as it is.

    Args:
        given: pairs and confidences.
        options: of sides.
    """
    layout = Layout.of(given.skeleton)
    flipped = given.by_frame(votes(given) < 0.0)
    return Sides(flipped, views_of(given, flipped, layout, options), layout.chains)


def votes(given: PairsInTime) -> np.ndarray:
    """Shape (person_frame, pair): votes for the first point being the left one, less those for the second."""
    points, used = given.pairs.points_m, np.asarray(given.pairs.used)
    across = points[:, :, 1] - points[:, :, 0]
    across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-12)
    centres = np.array([camera.centre_m for camera in given.rig.cameras])
    rays = points[:, :, None] - centres[:, None]
    rays = rays / np.maximum(np.linalg.norm(rays, axis=-1, keepdims=True), 1e-12)
    weight = 1.0 - np.abs(np.einsum("npvix,npx->npvi", rays, across))
    if given.confidence is not None:
        trust = given.confidence.reshape(-1, *given.confidence.shape[2:])
        weight = weight * np.take_along_axis(trust, np.maximum(used, 0).astype(np.int64), axis=3)
    for_it = np.where(used == np.arange(2), 1.0, -1.0)
    total: np.ndarray = for_it * np.where(used >= 0, np.nan_to_num(weight), 0.0)
    return total.sum(axis=(2, 3))
