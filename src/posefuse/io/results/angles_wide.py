"""Joint angles as a wide table: one row per frame and person, one column per angle."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from posefuse.biomechanics.marker_model import is_human
from posefuse.errors import ResultError
from posefuse.io.csv_columns import write_csv
from posefuse.io.results.format import ResultFacts, ResultFormat
from posefuse.model.joint_angles import AngleStatus, JointAngles
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction

_DECIMALS = 3


def require(facts: ResultFacts) -> None:
    """Refuse results that cannot have joint angles.

    Raises:
        ResultError: if the points are not in meters, or the skeleton has no known angles.
    """
    facts.require_meters("A wide table of joint angles")
    if facts.skeleton.tree is None and not is_human(facts.skeleton):
        raise ResultError(
            f"A wide table of joint angles needs a human skeleton or one with a body model, and {facts.skeleton.name} "
            "has no joint angles."
        )


def write(result: Reconstruction, path: Path, layer: LayerName) -> None:
    """Write the joint angles of all people, in degrees; those of the result's default layer.

    A result that was made without joint angles gives a table without rows.

    Raises:
        ResultError: if the result cannot have joint angles.
    """
    require(ResultFacts.of(result))
    write_csv(_tables(result), path)


def _tables(result: Reconstruction) -> Iterator[Mapping[str, np.ndarray]]:
    """Yield the columns of consecutive ranges of frames; frames without a person have no rows."""
    people = len(result.person_ids)
    if result.joint_angles is None:
        yield {title: np.empty(0) for title in ("frame", "time_s", "person")}
        return
    for part in result.windows():
        angles = part.joint_angles
        assert angles is not None
        status = np.asarray(angles.status[:]).reshape(part.n_frames * people, -1)
        degrees = np.asarray(angles.degrees[:], dtype=np.float64).reshape(status.shape)
        rows = np.flatnonzero((status != AngleStatus.ABSENT).any(axis=1))
        keys = {
            "frame": np.repeat(part.frame_numbers, people),
            "time_s": np.repeat(part.time_s, people),
            "person": np.tile(np.array(part.person_ids, dtype=object), part.n_frames),
        }
        columns = zip(_titles(angles), np.round(degrees, _DECIMALS).T, strict=True)
        yield {title: values[rows] for title, values in (*keys.items(), *columns)}


def _titles(angles: JointAngles) -> tuple[str, ...]:
    """Return the names of the columns, such as ``opensim_hip_flexion_r_deg``."""
    return tuple(f"{convention}_{name}_deg" for convention, name in zip(angles.conventions, angles.names, strict=True))


FORMAT = ResultFormat(
    name="angles_wide",
    files="angles_wide.csv",
    conventions="joint angles in degrees: one row per frame and person, one column per angle; missing is empty",
    lacks="standard deviations, statuses, points",
    endings=(".csv",),
    name_words=("angles_wide",),
    write_layer=write,
    require=require,
    additional_name="angles_wide.csv",
)
