"""Tables derived from a result's points: angles between keypoints, centers of mass and segment lengths."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from posefuse.biomechanics.center_of_mass import centers_of_mass
from posefuse.biomechanics.segment_lengths import segment_lengths
from posefuse.kinematics.joint_angles import angle_names, joint_angles, skeleton_angles
from posefuse.kinematics.pose_from_points import pose_of_points
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.masses import mass_table
from posefuse.skeleton.trees import Tree

Columns = Mapping[str, np.ndarray]
"""Columns of a table by name, all of the same length."""

CENTERS_FILE, LENGTHS_FILE = "com.csv", "lengths.csv"


def keypoint_angles(part: Reconstruction, parts_only: bool = False) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Return angles between segments and bones of the model layer, or, without one, of the solved layer.

    The angles of the root relative to the world are missing if the up axis is unknown.

    Args:
        part: range of frames.
        parts_only: whether to leave out the angles of the body, so that those of hands and faces remain.

    Returns:
        Names; shape (frame, person, angle), degrees; and standard deviations, NaN where unknown. Without a source of
        angles, there are no names.
    """
    skeleton, tree = part.skeleton, part.skeleton.tree
    up = part.rig.up or (0.0, 0.0, 1.0)
    names: tuple[str, ...] = ()
    degrees = np.empty((part.n_frames, len(part.person_ids), 0))
    if tree is None or part.unit != "m":
        return names, degrees, degrees
    poses = part.poses
    if poses is not None and (poses.segments, poses.bones) == skeleton.body_names[:2]:
        turns, directions = np.asarray(poses.turns[:]), np.asarray(poses.directions[:])
        names, degrees = skeleton_angles(skeleton, turns, directions, up)
    elif "solved" in part.layers and poses is None:
        names, degrees = joint_angles(tree, *pose_of_points(tree, np.asarray(part.layers["solved"].points_m[:])), up)
    root = _of_root(tree, names)
    if part.rig.up is None:
        degrees[..., root] = np.nan
    sds = np.full_like(degrees, np.nan)
    if poses is not None and names and poses.angles == names:
        sds = np.where(np.isfinite(degrees), np.asarray(poses.angle_sd_deg[:]), np.nan)
    first = len(angle_names(tree)) if parts_only else 0
    return names[first:], degrees[..., first:], sds[..., first:]


def _of_root(tree: Tree, names: Iterable[str]) -> list[bool]:
    """Return which angles belong to the root segment."""
    return [bool(tree.segments) and name.startswith(f"{tree.segments[0]}.") for name in names]


def body_tables(result: Reconstruction) -> dict[str, Iterator[Columns]]:
    """Return the tables written beside a result, by file name.

    These are segment lengths, unless frames are unrelated, and centers of mass if a mass table is set.

    Args:
        result: its best layer, or the layer set in its options, is used.

    Raises:
        SkeletonError: if a center of mass is requested and the skeleton lacks a segment.
    """
    if result.unit != "m":
        return {}
    layer, _ = result.best_layer(result.options.layer)
    tables: dict[str, Iterator[Columns]] = {}
    if result.skeleton.edges and result.has_identities:
        tables[LENGTHS_FILE] = iter([_length_columns(result, layer)])
    name = result.options.subject.mass_table
    if name != "none":
        mass_table(name).check(result.skeleton)
        tables[CENTERS_FILE] = (_center_columns(part, layer) for part in result.chunks())
    return tables


def _length_columns(result: Reconstruction, layer: LayerName) -> Columns:
    """Return the columns of the table of segment lengths."""
    rows = segment_lengths(result.chunks(), layer)
    return {
        "person": np.array([row.person for row in rows], dtype=object),
        "near": np.array([row.near for row in rows], dtype=object),
        "far": np.array([row.far for row in rows], dtype=object),
        "median_m": np.array([row.median_m for row in rows]),
        "sd_m": np.array([row.sd_m for row in rows]),
        "frames": np.array([row.n_frames for row in rows], dtype=np.int64),
        "layer": np.array([layer] * len(rows), dtype=object),
    }


def _center_columns(part: Reconstruction, layer: LayerName) -> Columns:
    """Return the columns of the table of centers of mass."""
    rows = centers_of_mass(part.layers[layer], part.skeleton, mass_table(part.options.subject.mass_table))
    people = len(part.person_ids)
    positions = rows.xyz_m.reshape(-1, 3)
    known = rows.known_share.ravel()
    columns = {
        "frame": np.repeat(part.frame_numbers, people),
        "time_s": np.repeat(part.time_s, people),
        "person": np.tile(np.array(part.person_ids, dtype=object), part.n_frames),
        **{f"{axis}_m": positions[:, i] for i, axis in enumerate("xyz")},
        "known_share": known,
        "filled_share": rows.filled_share.ravel(),
        "layer": np.array([layer] * len(known), dtype=object),
    }
    mass_kg = part.options.subject.mass_kg
    return columns if mass_kg is None else {**columns, "known_mass_kg": mass_kg * known}
