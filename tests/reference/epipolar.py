"""Agreement of people with a relative pose, written plainly: one point at a time, with planes through the baseline."""

import numpy as np


def point_agreement(pose, ray_a, ray_b, variance_a, variance_b, dof):
    """Return the robust cost of two rays and the distances from both cameras in baselines.

    Args:
        pose: rotation and unit translation of the second view from the first.
        ray_a: unit vector.
        ray_b: unit vector.
        variance_a: variance of the direction per axis in rad^2.
        variance_b: the same of the second view.
        dof: degrees of freedom.
    """
    rotation, translation = pose
    essential = np.cross(np.eye(3), translation).T @ rotation
    error = ray_b @ essential @ ray_a

    def across(normal, ray):
        return normal @ normal - (normal @ ray) ** 2

    variance = variance_b * across(essential @ ray_a, ray_b) + variance_a * across(essential.T @ ray_b, ray_a)
    # Nearest points of the two lines.
    lines = np.stack([rotation @ ray_a, -ray_b], axis=1)
    along = np.linalg.lstsq(lines, -translation, rcond=None)[0]
    return np.log1p(error**2 / variance / dof), *along


def people_agreement(pose, rays_a, rays_b, variance_a, variance_b, mirror, dof):
    """Return the mean cost, number of points, number behind a camera and mean distances of two people in a sample.

    The labels of the second person, or those of the other side, are used: the ones that agree better.
    """
    found = []
    for labels in (np.arange(len(mirror)), mirror):
        points = [
            point_agreement(pose, rays_a[k], rays_b[other], variance_a[k], variance_b[other], dof)
            for k, other in enumerate(labels)
            if np.isfinite(rays_a[k]).all() and np.isfinite(rays_b[other]).all()
        ]
        if points:
            cost, depth_a, depth_b = np.array(points).T
            behind = ((depth_a <= 0.0) | (depth_b <= 0.0)).sum()
            found.append((cost.mean(), len(points), behind, depth_a.mean(), depth_b.mean()))
    return min(found, default=(0.0, 0, 0, 0.0, 0.0))
