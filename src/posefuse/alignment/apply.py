"""Apply an alignment to a result: cameras, points, covariances and poses."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from posefuse.kinematics.angle_sds import with_root_angle_sds
from posefuse.model.alignment import Alignment
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.options.alignment import AlignOptions
from posefuse.model.reconstruction import Layer, Reconstruction, pack_covariance, unpack_covariance
from posefuse.model.track_events import Poses


def align(part: Reconstruction, alignment: Alignment) -> Reconstruction:
    """Return a range of frames in the aligned world; pixels and assignments stay unchanged.

    Args:
        part: in the calibration's world.
        alignment: aligned world from calibration's world.
    """
    rig = aligned_rig(part.rig, alignment)
    return replace(
        part,
        rig=rig,
        layers={name: _layer(layer, alignment) for name, layer in part.layers.items()},
        poses=None if part.poses is None else _poses(part.poses, alignment, rig.up),
        joint_angles=None,  # They refer to the vertical of the world.
        alignment=alignment,
    )


def align_parts(parts: Iterable[Reconstruction], alignment: Alignment) -> Iterator[Reconstruction]:
    """Return ranges of frames in the aligned world.

    Args:
        parts: from cameras whose world is scaled already.
        alignment: aligned world from calibration's world.
    """
    alignment_without_scale = replace(alignment, scale=1.0)
    # Unlike a generator, a map does not keep the last range while the next one is computed.
    return map(lambda part: replace(align(part, alignment_without_scale), alignment=alignment), parts)


def identity_alignment(rig: CameraRig) -> Alignment:
    """Return the alignment that keeps the calibration's world."""
    return Alignment(
        np.eye(3), np.zeros(3), up_axis=rig.up_axis, calibration_up_axis=rig.up_axis,
        inferred_up=rig.inferred_up, calibration_inferred_up=rig.inferred_up,
    )  # fmt: skip


def combine_with_scale(alignment_without_scale: Alignment, scale: float, options: AlignOptions) -> Alignment:
    """Return an alignment of a scaled world as an alignment from the calibration's world."""
    height = f"{options.height_m:g} m tall" if options.height_m is not None else None
    pair = " to ".join(options.length_between)
    reason = f"the subject is {height}" if height else f"the distance from {pair} is {options.length_m} m"
    return replace(
        alignment_without_scale,
        scale=scale,
        steps=(f"Lengths are multiplied by {scale:.5g}: {reason}.", *alignment_without_scale.steps),
    )


def scaled_rig(rig: CameraRig, scale: float) -> CameraRig:
    """Return the cameras in a scaled world."""
    return aligned_rig(rig, replace(identity_alignment(rig), scale=scale))


def scaled_layer(layer: Layer, scale: float) -> Layer:
    """Return the points in a scaled world."""
    return _layer(layer, Alignment(np.eye(3), np.zeros(3), scale))


def in_calibration_world(part: Reconstruction) -> Reconstruction:
    """Return a result in the calibration's world; a result without alignment is returned unchanged."""
    if part.alignment is None:
        return part
    return replace(align(part, part.alignment.inverse), alignment=None)


def aligned_rig(rig: CameraRig, alignment: Alignment) -> CameraRig:
    """Return the cameras in the aligned world, where they see the same pixels."""
    cameras = tuple(_camera(camera, alignment) for camera in rig.cameras)
    scaled = replace(rig, cameras=cameras, meters_per_unit=rig.meters_per_unit * alignment.scale)
    if alignment.scale != 1.0:
        scaled = replace(scaled, covariances=(), correlation=None)
    return scaled.with_up(alignment.up_axis, alignment.inferred_up)


def _camera(camera: Camera, alignment: Alignment) -> Camera:
    rotation = camera.rotation @ alignment.rotation.T
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = alignment.scale * camera.translation_m - rotation @ alignment.shift_m
    return replace(camera, camera_from_world=pose)


def _layer(layer: Layer, alignment: Alignment) -> Layer:
    covariance = unpack_covariance(np.asarray(layer.covariance_m2[:]))
    turned = alignment.scale**2 * alignment.rotation @ covariance @ alignment.rotation.T
    return replace(
        layer,
        points_m=alignment.points(np.asarray(layer.points_m[:])),
        covariance_m2=pack_covariance(turned),
    )


def _poses(poses: Poses, alignment: Alignment, up: tuple[float, float, float] | None) -> Poses:
    turned = replace(
        poses,
        turns=alignment.rotation @ np.asarray(poses.turns[:]),
        directions=np.asarray(poses.directions[:]) @ alignment.rotation.T,
        shape_m=alignment.scale * np.asarray(poses.shape_m[:]),
        shape_sd_m=alignment.scale * np.asarray(poses.shape_sd_m[:]),
    )
    # The angles of the root are relative to the world, so their standard deviations depend on it.
    return with_root_angle_sds(turned, up)
