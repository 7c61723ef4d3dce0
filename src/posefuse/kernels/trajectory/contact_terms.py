"""Terms of keypoints that rest on the ground in the trajectory system.

The band has the layout of :mod:`posefuse.kernels.trajectory.band`; the first axis is the keypoint on the ground.
"""

from typing import Any, NamedTuple

from posefuse.kernels.jit import kernel


class ContactTerms(NamedTuple):
    """Keypoints on the ground.

    Attributes:
        keypoints: shape (contact,), int64: indices of the keypoints.
        rest: shape (contact, frame - 1): inverse variance of the step from each frame to the next, m^-2; 0 without
            contact.
        steps_m: shape (frame - 1, 3): step of the ground from each frame to the next.
        normal: shape (3,): unit vector that points up from the ground.
        heights_m: shape (contact, frame): height of the resting keypoint along the normal.
        support: shape (contact, frame): inverse variance of the height, m^-2; 0 without contact.
    """

    keypoints: Any
    rest: Any
    steps_m: Any
    normal: Any
    heights_m: Any
    support: Any


@kernel
def add_contact(contact, paths, band, rhs):
    """Add the terms that resting keypoints move with the ground and stay at its height.

    Args:
        contact: ContactTerms.
        paths: shape (keypoint, frame, 3).
        band: shape (keypoint, frame, REACH + 1, 3, 3), added to.
        rhs: shape (keypoint, frame, 3), added to: negative gradient.
    """
    keypoints, rest, steps, normal, heights, support = contact
    frames = paths.shape[1]
    for c in range(keypoints.shape[0]):
        k = keypoints[c]
        for f in range(frames - 1):
            w = rest[c, f]
            if w > 0.0:
                for i in range(3):
                    slip = paths[k, f + 1, i] - paths[k, f, i] - steps[f, i]
                    rhs[k, f, i] += w * slip
                    rhs[k, f + 1, i] -= w * slip
                    band[k, f, 0, i, i] += w
                    band[k, f + 1, 0, i, i] += w
                    band[k, f + 1, 1, i, i] -= w
        for f in range(frames):
            w = support[c, f]
            if w > 0.0:
                above = -heights[c, f]
                for i in range(3):
                    above += normal[i] * paths[k, f, i]
                for i in range(3):
                    rhs[k, f, i] -= w * above * normal[i]
                    for j in range(3):
                        band[k, f, 0, i, j] += w * normal[i] * normal[j]
