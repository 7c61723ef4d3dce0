"""Projection of predicted bodies into all views, with covariances."""

import math

import numpy as np

from posefuse.kernels.jit import kernel
from posefuse.kernels.tracking.body_kinematics import locate_nodes, node_jacobian
from posefuse.kernels.tracking.point_projection import (
    pixel_covariance,
    point_covariance,
    project_node,
    squared_px_per_m,
)


@kernel
def project_people(cameras, body, state, points, covariance, pixels, pixel_covariances, scale_px_per_m):
    """Project the predicted keypoints of all people into all views, with covariances.

    Args:
        cameras: the camera array.
        body: a Body.
        state: a State.
        points: shape (person, keypoint, 3), written; NaN if the tree has no such keypoint.
        covariance: shape (person, keypoint, 6), written: m^2.
        pixels: shape (person, view, keypoint, 2), written: NaN where a view cannot see the point.
        pixel_covariances: shape (person, view, keypoint, 3), written: uu, uv, vv of the predicted pixel, px^2.
        scale_px_per_m: shape (person, view, keypoint), written: length of a meter in px.
    """
    n_pose = state.velocity.shape[1]
    jacobian = np.zeros((body.parents.shape[0], 3, n_pose + state.shape.shape[1]))
    nodes = np.empty((body.parents.shape[0], 3))
    b = body
    for p in range(state.root.shape[0]):
        turns, bones, shape = state.turns[p], state.bones[p], state.shape[p]
        m = n_pose + (shape.shape[0] if state.free[p] != 0 else 0)
        locate_nodes(
            b.parents, b.carriers, b.is_bone, b.offsets, b.shape_of, b.signs, state.root[p], turns, bones, shape, nodes
        )
        node_jacobian(
            b.parents, b.carriers, b.is_bone, b.offsets, b.shape_of, b.signs, n_pose, turns, bones, shape, jacobian
        )
        for k in range(b.keypoint_nodes.shape[0]):
            node = b.keypoint_nodes[k]
            if node < 0:
                for i in range(3):
                    points[p, k, i] = math.nan
                for i in range(6):
                    covariance[p, k, i] = math.nan
                for v in range(cameras.shape[0]):
                    pixels[p, v, k, 0] = math.nan
                    pixels[p, v, k, 1] = math.nan
                continue
            for i in range(3):
                points[p, k, i] = nodes[node, i]
            point_covariance(jacobian, b.starts, b.columns, node, m, state.covariance[p], covariance[p, k])
            for v in range(cameras.shape[0]):
                view = project_node(cameras, v, nodes, node)
                pixels[p, v, k, 0] = view[1]
                pixels[p, v, k, 1] = view[2]
                uu, uv, vv = pixel_covariance(view, covariance[p, k])
                pixel_covariances[p, v, k, 0] = uu
                pixel_covariances[p, v, k, 1] = uv
                pixel_covariances[p, v, k, 2] = vv
                scale_px_per_m[p, v, k] = math.sqrt(squared_px_per_m(view))
