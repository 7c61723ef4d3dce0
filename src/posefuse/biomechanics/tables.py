"""Tables derived from a result's points: angles between keypoints, centers of mass and segment lengths."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial

import numpy as np

from posefuse.biomechanics.center_of_mass import CentersOfMass, centers_of_mass, masses_of
from posefuse.biomechanics.segment_lengths import segment_lengths
from posefuse.kinematics.joint_angles import angle_names, joint_angles, skeleton_angles
from posefuse.kinematics.pose_from_points import pose_of_points
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.masses import Masses
from posefuse.skeleton.trees import Tree

Columns = Mapping[str, np.ndarray]
"""Columns of a table by name, all of the same length."""

CENTERS_FILE, LENGTHS_FILE, MASSES_FILE = "com.csv", "lengths.csv", "segment_masses.csv"


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


def body_tables(result: Reconstruction) -> dict[str, Callable[[Reconstruction], Iterable[Columns]]]:
    """Return functions that compute the tables written beside a result, by file name.

    These are segment lengths, unless frames are unrelated, centers of mass of human bodies, and segment masses if the
    mass of the subject is known.

    Args:
        result: its best layer, or the layer set in its options, is used.

    Raises:
        SkeletonError: if a center of mass is requested and the skeleton lacks a segment.
    """
    if result.unit != "m":
        return {}
    layer, _ = result.best_layer(result.options.layer)
    tables: dict[str, Callable[[Reconstruction], Iterable[Columns]]] = {}
    if result.skeleton.edges and result.has_identities:
        tables[LENGTHS_FILE] = partial(_length_columns, layer)
    masses = masses_of(result)
    if masses is not None:
        tables[CENTERS_FILE] = partial(_center_columns, masses)
        if result.options.subject.mass_kg is not None:
            tables[MASSES_FILE] = partial(_mass_columns, masses)
    return tables


def _length_columns(layer: LayerName, result: Reconstruction) -> Iterator[Columns]:
    """Yield the columns of the table of segment lengths."""
    rows = segment_lengths(result.windows(), layer)
    yield {
        "person": np.array([row.person for row in rows], dtype=object),
        "near": np.array([row.near for row in rows], dtype=object),
        "far": np.array([row.far for row in rows], dtype=object),
        "median_m": np.array([row.median_m for row in rows]),
        "sd_m": np.array([row.sd_m for row in rows]),
        "frames": np.array([row.n_frames for row in rows], dtype=np.int64),
        "layer": np.array([layer] * len(rows), dtype=object),
    }


def _center_columns(masses: Masses, result: Reconstruction) -> Iterator[Columns]:
    """Yield the columns of the table of centers of mass, one range of frames at a time."""
    people, start, mass_kg = len(result.person_ids), 0, result.options.subject.mass_kg
    for part in centers_of_mass(result, masses):
        n_frames = len(part.xyz_m)
        frames = slice(start, start + n_frames)
        known = part.known_share.ravel()
        columns = {
            "frame": np.repeat(result.frame_numbers[frames], people),
            "time_s": np.repeat(result.time_s[frames], people),
            "person": np.tile(np.array(result.person_ids, dtype=object), n_frames),
            **_motion_columns(part),
            "known_share": known,
            "filled_share": part.filled_share.ravel(),
            "layer": np.array([part.layer] * len(known), dtype=object),
        }
        yield columns if mass_kg is None else {**columns, "known_mass_kg": mass_kg * known}
        start += n_frames


def _motion_columns(part: CentersOfMass) -> Columns:
    """Return the columns of positions and velocities, each with standard deviations."""
    arrays = {
        "{}_m": part.xyz_m,
        "sd_{}_m": part.sd_m,
        "v{}_m_s": part.velocity_m_s,
        "sd_v{}_m_s": part.velocity_sd_m_s,
    }
    return {
        title.format(axis): values[..., i].ravel() for title, values in arrays.items() for i, axis in enumerate("xyz")
    }


def _mass_columns(masses: Masses, result: Reconstruction) -> Iterator[Columns]:
    """Yield the columns of the table of segment masses."""
    mass_kg = result.options.subject.mass_kg
    assert mass_kg is not None
    shares = np.array([segment.mass for segment in masses.segments])
    shares = shares / shares.sum()
    yield {
        "segment": np.array([segment.name for segment in masses.segments], dtype=object),
        "share": shares,
        "mass_kg": mass_kg * shares,
        "table": np.array([masses.name] * len(shares), dtype=object),
    }
