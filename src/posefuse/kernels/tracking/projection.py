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
from posefuse.kernels.tracking.records import Pose


@kernel
def project_people(cameras, body, state, out):
    """Project the predicted keypoints of all people into all views, with covariances.

    Args:
        cameras: the camera array.
        body: a Body.
        state: a State.
        out: ProjectedKeypoints, written.
    """
    points, covariance, pixels, pixel_covariances, scale_px_per_m = out
    n_pose = state.velocity.shape[1]
    jacobian = np.zeros((body.parents.shape[0], 3, n_pose + state.shape.shape[1]))
    nodes = np.empty((body.parents.shape[0], 3))
    b = body
    for p in range(state.root.shape[0]):
        pose = Pose(state.root[p], state.turns[p], state.bones[p], state.shape[p])
        m = n_pose + (pose.shape.shape[0] if state.free[p] != 0 else 0)
        locate_nodes(body, pose, nodes)
        node_jacobian(body, pose, n_pose, jacobian)
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
                    for i in range(3):
                        pixel_covariances[p, v, k, i] = math.nan
                    scale_px_per_m[p, v, k] = math.nan
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
