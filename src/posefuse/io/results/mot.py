"""MOT, the motion file of OpenSim: joint angles of one person as coordinates of a full-body model, y up.

The coordinates are those of the model of Rajagopal et al. 2016, in degrees and m. Its pelvis turns first by the tilt,
then by the list, then by the rotation; the angles of ``angles.csv``, in which the rotation comes first, are converted.
Angles without a value in any frame are left out, so that OpenSim keeps their defaults; other missing values are
``nan``.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from posefuse.biomechanics.person_frames import model_world
from posefuse.errors import ResultError
from posefuse.io.motion_tables import write_coordinates
from posefuse.io.results.axes import y_up_from_world
from posefuse.io.results.format import ResultFormat
from posefuse.io.results.timing import export_rate, regular_rows
from posefuse.model.joint_angles import OPENSIM, JointAngles
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction

_PELVIS = ("pelvis_tilt", "pelvis_list", "pelvis_rotation")
_POSITION = ("pelvis_tx", "pelvis_ty", "pelvis_tz")


def has_coordinates(result: Reconstruction) -> bool:
    """Return whether a result has what the format holds."""
    angles = result.joint_angles
    return angles is not None and OPENSIM in angles.conventions and result.rig.up_axis is not None


def write(result: Reconstruction, person: str, path: Path, layer: LayerName) -> None:
    """Write one person; the angles are those of the result's default layer.

    Raises:
        ResultError: if the result has no joint angles of a human body, its up axis is unknown, or the frame rate is
            unknown or not constant.
    """
    angles = result.joint_angles
    if angles is None or OPENSIM not in angles.conventions:
        raise ResultError(
            "A MOT file holds the joint angles of a human body, and this result has none. Reconstruct a skeleton with "
            "hips, knees and shoulders."
        )
    if result.rig.up_axis is None:
        raise ResultError("A MOT file needs the up axis, and that of this result is unknown. Reconstruct with `up`.")
    rate = export_rate(result, "MOT")
    table = _coordinates(result, angles, result.person_ids.index(person))
    rows, n_rows = regular_rows(result)
    names = [name for name, column in table.items() if np.isfinite(column).any()]
    values = np.full((n_rows, len(names)), np.nan)
    values[rows] = np.stack([table[name] for name in names], axis=1) if names else np.empty((len(rows), 0))
    start = float(result.time_s[0]) if np.isfinite(result.time_s[0]) else float(result.frame_numbers[0]) / rate
    time_s = start + np.arange(n_rows) / rate
    write_coordinates(path, time_s, names, values, [f"layer={angles.layer}"])


def _coordinates(result: Reconstruction, angles: JointAngles, person: int) -> dict[str, np.ndarray]:
    """Return the coordinates of a person in OpenSim's order, each of shape (frame,), in degrees or m."""
    columns = [i for i, convention in enumerate(angles.conventions) if convention == OPENSIM]
    parts = [part.joint_angles for part in result.windows() if part.joint_angles is not None]
    degrees = np.concatenate([part.degrees[:, person, columns] for part in parts]).astype(np.float64)
    pelvis_m = np.concatenate([part.pelvis_m[:, person] for part in parts]) @ y_up_from_world(result.rig.up_axis).T
    names = [angles.names[i] for i in columns]
    tilt, to_list, rotation = (degrees[:, names.index(name)] for name in _PELVIS)
    known = np.isfinite(tilt + to_list + rotation)
    pelvis = np.full((len(degrees), 3), np.nan)
    if known.any():
        turned = Rotation.from_euler("YXZ", np.stack([rotation, to_list, tilt], axis=1)[known], degrees=True)
        # Angles of the result are relative to other horizontal axes than those of the file.
        own = Rotation.from_matrix(y_up_from_world(result.rig.up_axis) @ model_world(np.array(result.rig.up)).T)
        pelvis[known] = np.degrees(np.unwrap((own * turned).as_euler("ZXY"), axis=0))
    found = dict(zip(_PELVIS, pelvis.T, strict=True)) | dict(zip(_POSITION, pelvis_m.T, strict=True))
    return found | {name: degrees[:, i] for i, name in enumerate(names) if name not in _PELVIS}


FORMAT = ResultFormat(
    name="mot",
    files="<person>.mot",
    conventions="OpenSim's coordinates in degrees and m, y up; missing is nan",
    lacks="standard deviations, statuses, points",
    endings=(".mot",),
    write_person=write,
)
