"""Occlusion: points that capsules hide from a camera."""

from math import sqrt

from posefuse.kernels.jit import inline, kernel


@inline
def _segment_distance_squared(a, from_a, b, from_b):
    """Return the squared distance between two segments (start, vector to the end); the first has length > 0.

    Ericson (2005), Real-Time Collision Detection, section 5.1.9.
    """
    rx, ry, rz = a[0] - b[0], a[1] - b[1], a[2] - b[2]
    aa = from_a[0] * from_a[0] + from_a[1] * from_a[1] + from_a[2] * from_a[2]
    bb = from_b[0] * from_b[0] + from_b[1] * from_b[1] + from_b[2] * from_b[2]
    ab = from_a[0] * from_b[0] + from_a[1] * from_b[1] + from_a[2] * from_b[2]
    ar = from_a[0] * rx + from_a[1] * ry + from_a[2] * rz
    br = from_b[0] * rx + from_b[1] * ry + from_b[2] * rz
    cross = aa * bb - ab * ab
    s = min(1.0, max(0.0, (ab * br - ar * bb) / cross)) if cross > 1e-12 * aa * bb else 0.0
    t = (ab * s + br) / bb if bb > 0.0 else 0.0
    if t < 0.0 or t > 1.0 or bb == 0.0:
        t = min(1.0, max(0.0, t))
        s = min(1.0, max(0.0, (ab * t - ar) / aa))
    dx = rx + s * from_a[0] - t * from_b[0]
    dy = ry + s * from_a[1] - t * from_b[1]
    dz = rz + s * from_a[2] - t * from_b[2]
    return dx * dx + dy * dy + dz * dz


@kernel
def mark_occluded(center_m, points_m, starts_m, ends_m, radii_m, owners, margin_m, occluded):
    """Mark the points that a capsule of another owner hides from a camera.

    Args:
        center_m: shape (3,): camera center.
        points_m: shape (frame, person, keypoint, 3); NaN where absent, which is never occluded.
        starts_m: shape (frame, capsule, 3): one end of the axis, NaN where the capsule is absent.
        ends_m: shape (frame, capsule, 3): the other end.
        radii_m: shape (capsule,).
        owners: shape (capsule,), int64: the person whose body contains the capsule, -1 for an object.
        margin_m: the last part of the line of sight, before the point, that no capsule can block.
        occluded: shape (frame, person, keypoint), bool, set to True where occluded.
    """
    for t in range(points_m.shape[0]):
        for p in range(points_m.shape[1]):
            for k in range(points_m.shape[2]):
                dx = points_m[t, p, k, 0] - center_m[0]
                dy = points_m[t, p, k, 1] - center_m[1]
                dz = points_m[t, p, k, 2] - center_m[2]
                distance = sqrt(dx * dx + dy * dy + dz * dz)
                if not distance > margin_m:
                    continue
                fraction = (distance - margin_m) / distance
                line_of_sight = (fraction * dx, fraction * dy, fraction * dz)
                camera = (center_m[0], center_m[1], center_m[2])
                for c in range(starts_m.shape[1]):
                    if owners[c] == p:
                        continue
                    a = (starts_m[t, c, 0], starts_m[t, c, 1], starts_m[t, c, 2])
                    along = (ends_m[t, c, 0] - a[0], ends_m[t, c, 1] - a[1], ends_m[t, c, 2] - a[2])
                    if _segment_distance_squared(camera, line_of_sight, a, along) < radii_m[c] * radii_m[c]:
                        occluded[t, p, k] = True
                        break
