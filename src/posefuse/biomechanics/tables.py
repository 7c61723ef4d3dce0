"""What follows from a result's points: joint angles, centres of mass, segment lengths, as tables to be written."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from posefuse.biomechanics.center_of_mass import centres_of_mass
from posefuse.biomechanics.segment_lengths import segment_lengths
from posefuse.kinematics.joint_angles import joint_angles, skeleton_angles
from posefuse.kinematics.pose_from_points import pose_of_points
from posefuse.model.cameras import up_vector
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.masses import mass_table
from posefuse.skeleton.trees import Tree

Columns = Mapping[str, np.ndarray]
"""Columns of a table by name, all of one length."""

CENTRES, LENGTHS = "com.csv", "lengths.csv"


def angles_of(part: Reconstruction) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Joint angles of fitted bodies, or where none was fitted of the points of the solved layer, by the same names.

    How the root stands in the world is not known where nobody knows which way is up; and how well it is, not where the
    world was laid anew.

    Args:
        part: a range of frames.

    Returns:
        Names; shape (frame, person, angle), degrees; and their standard deviations, NaN where they are not known. No
        names where there is neither.
    """
    skeleton, tree = part.skeleton, part.skeleton.tree
    up = up_vector(part.rig.up_axis or "z")
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
    if part.rig.up_axis is None:
        degrees[..., root] = np.nan
    sds = np.full_like(degrees, np.nan)
    if poses is not None and names and poses.angles == names:
        sds = np.where(np.isfinite(degrees), np.asarray(poses.angle_sd_deg[:]), np.nan)
        if part.alignment is not None:
            sds[..., root] = np.nan
    return names, degrees, sds


def _of_root(tree: Tree, names: Iterable[str]) -> list[bool]:
    return [bool(tree.segments) and name.startswith(f"{tree.segments[0]}.") for name in names]


def tables_of(result: Reconstruction) -> dict[str, Iterator[Columns]]:
    """Tables that go beside a result, by file name: lengths of segments, and centres of mass where a table is named.

    Args:
        result: whose best layer, or the one that its options name, is taken.

    Raises:
        SkeletonError: if a centre of mass is asked for and the skeleton lacks a segment.
    """
    if result.unit != "m":
        return {}
    layer, _ = result.best_layer(result.options.layer)
    tables: dict[str, Iterator[Columns]] = {}
    if result.skeleton.edges:
        tables[LENGTHS] = iter([_lengths(result, layer)])
    name = result.options.subject.mass_table
    if name != "none":
        mass_table(name).check(result.skeleton)
        tables[CENTRES] = (_centres(part, layer) for part in result.chunks())
    return tables


def _lengths(result: Reconstruction, layer: LayerName) -> Columns:
    found = segment_lengths(result.chunks(), layer)
    return {
        "person": np.array([each.person for each in found], dtype=object),
        "near": np.array([each.near for each in found], dtype=object),
        "far": np.array([each.far for each in found], dtype=object),
        "median_m": np.array([each.median_m for each in found]),
        "sd_m": np.array([each.sd_m for each in found]),
        "frames": np.array([each.n_frames for each in found], dtype=np.int64),
        "layer": np.array([layer] * len(found), dtype=object),
    }


def _centres(part: Reconstruction, layer: LayerName) -> Columns:
    found = centres_of_mass(part.layers[layer], part.skeleton, mass_table(part.options.subject.mass_table))
    people = len(part.person_ids)
    positions = found.xyz_m.reshape(-1, 3)
    known = found.known_share.ravel()
    columns = {
        "frame": np.repeat(part.frame_numbers, people),
        "time_s": np.repeat(part.time_s, people),
        "person": np.tile(np.array(part.person_ids, dtype=object), part.n_frames),
        **{f"{axis}_m": positions[:, i] for i, axis in enumerate("xyz")},
        "known_share": known,
        "filled_share": found.filled_share.ravel(),
        "layer": np.array([layer] * len(known), dtype=object),
    }
    mass_kg = part.options.subject.mass_kg
    return columns if mass_kg is None else {**columns, "known_mass_kg": mass_kg * known}
