"""Deviations of keypoints from bodies in plain NumPy, in the principal axes of the measurement."""

import numpy as np

from posefuse.model.reconstruction import pack_covariance, unpack_covariance

NU = 3.0


def deviating_points(body, measured, sd_m):
    """Return points of bodies with deviations, and their covariances; all points exist and none is rigid."""
    residual, noise = measured[0] - body[0], unpack_covariance(measured[1])
    values, axes = np.linalg.eigh(noise)
    back = np.swapaxes(axes, -1, -2)
    variance = np.broadcast_to(np.square(sd_m), residual.shape[:-1])[..., None]
    along = (back @ residual[..., None])[..., 0]
    squared = (along**2 / (values + variance)).sum(axis=-1, keepdims=True)
    gains = variance / (values + variance) * np.minimum((NU + 3.0) / (NU + squared), 1.0)
    kept = axes * np.sqrt(1.0 - gains**2)[..., None, :] @ back
    added = axes * ((1.0 - gains) ** 2 * variance + gains**2 * values)[..., None, :] @ back
    covariance = kept @ unpack_covariance(body[1]) @ kept + added
    return body[0] + (axes @ (gains * along)[..., None])[..., 0], pack_covariance(covariance)
