"""Concatenate ranges of a reconstruction in memory, holding no range twice."""

from collections.abc import Iterable
from dataclasses import fields, replace

import numpy as np

from posefuse.errors import ResultError
from posefuse.model.joint_angles import ANGLES_OVER_TIME
from posefuse.model.label_swaps import Swaps
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.model.track_events import OVER_TIME
from posefuse.model.tracks import Tracks

_LAYER = tuple(field.name for field in fields(Layer))


def concatenate_ranges(parts: Iterable[Reconstruction], n_frames: int) -> Reconstruction:
    """Return consecutive ranges of frames as one reconstruction.

    Args:
        parts: at least one range; fields that do not depend on the frame are taken from the first.
        n_frames: number of frames of all ranges.

    Raises:
        ResultError: if the ranges have another number of frames.
    """
    first: Reconstruction | None = None
    whole: dict[str, np.ndarray] = {}
    events: dict[object, None] = {}
    at = 0
    for part in parts:
        first = first or part
        stop = at + part.n_frames
        for name, piece in _over_time(part).items():
            if name not in whole:
                whole[name] = np.empty((n_frames, *piece.shape[1:]), piece.dtype)
            if stop <= n_frames:
                whole[name][at:stop] = piece
        # A producer of ranges may repeat events.
        events |= dict.fromkeys(part.events)
        at = stop
    if first is None or at != n_frames:
        raise ResultError(f"The ranges have {at} frames in total, but the reconstruction has {n_frames}.")
    return _concatenated(first, whole, tuple(events))


def _over_time(part: Reconstruction) -> dict[str, np.ndarray]:
    """Return every array whose first axis is the frame, by a unique name."""
    found = {"frame_numbers": part.frame_numbers, "time_s": part.time_s}
    for layer, arrays in part.layers.items():
        found |= {f"{layer}.{name}": getattr(arrays, name)[:] for name in _LAYER}
    if part.tracks is not None:
        found |= {"tracks.detection": part.tracks.detection[:], "tracks.state": part.tracks.state[:]}
    if part.swaps is not None:
        found["swaps.state"] = part.swaps.state[:]
    if part.poses is not None:
        found |= {f"poses.{name}": getattr(part.poses, name)[:] for name in OVER_TIME}
    if part.joint_angles is not None:
        found |= {f"angles.{name}": getattr(part.joint_angles, name)[:] for name in ANGLES_OVER_TIME}
    return {name: np.asarray(array) for name, array in found.items()}


def _concatenated(first: Reconstruction, whole: dict[str, np.ndarray], events: tuple) -> Reconstruction:
    layers = {layer: Layer(*(whole[f"{layer}.{name}"] for name in _LAYER)) for layer in first.layers}
    poses = first.poses
    if poses is not None:
        poses = replace(poses, **{name: whole[f"poses.{name}"] for name in OVER_TIME})
    angles = first.joint_angles
    if angles is not None:
        angles = replace(angles, **{name: whole[f"angles.{name}"] for name in ANGLES_OVER_TIME})
    return replace(
        first,
        frame_numbers=whole["frame_numbers"],
        time_s=whole["time_s"],
        layers=layers,
        tracks=None
        if first.tracks is None
        else Tracks(first.person_ids, whole["tracks.detection"], whole["tracks.state"]),
        swaps=None if first.swaps is None else Swaps(first.swaps.chains, whole["swaps.state"]),
        poses=poses,
        joint_angles=angles,
        events=events,
    )
