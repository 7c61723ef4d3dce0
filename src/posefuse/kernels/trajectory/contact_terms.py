"""Terms of keypoints that rest on the ground in the trajectory system.

The first axis is the keypoint on the ground.
"""

from typing import Any, NamedTuple

from posefuse.kernels.cameras.observation_rows import BLOCK
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
def add_contact(contact, paths, system):
    """Add the terms that resting keypoints move with the ground and stay at its height.

    Args:
        contact: ContactTerms.
        paths: shape (keypoint, frame, 3).
        system: PathSystem, added to.
    """
    keypoints, rest, steps, normal, heights, support = contact
    diagonal, coupling, rhs, _ = system
    frames = paths.shape[1]
    for c in range(keypoints.shape[0]):
        k = keypoints[c]
        for f in range(frames):
            b = f // BLOCK
            j = f % BLOCK
            w = rest[c, f] if f < frames - 1 else 0.0
            if w > 0.0:
                next_b = (f + 1) // BLOCK
                next_j = (f + 1) % BLOCK
                coupling[k, next_b, next_j] -= w
                for i in range(3):
                    slip = paths[k, f + 1, i] - paths[k, f, i] - steps[f, i]
                    rhs[k, b, i * BLOCK + j] += w * slip
                    rhs[k, next_b, i * BLOCK + next_j] -= w * slip
                    # The diagonal of a matrix has the rows 0, 3 and 5.
                    row = (i * (7 - i)) // 2
                    diagonal[k, b, row * BLOCK + j] += w
                    diagonal[k, next_b, row * BLOCK + next_j] += w
            w = support[c, f]
            if w > 0.0:
                above = -heights[c, f]
                for i in range(3):
                    above += normal[i] * paths[k, f, i]
                for i in range(3):
                    rhs[k, b, i * BLOCK + j] -= w * above * normal[i]
                    for n in range(i, 3):
                        diagonal[k, b, ((i * (5 - i)) // 2 + n) * BLOCK + j] += w * normal[i] * normal[n]
