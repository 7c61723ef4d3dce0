"""Write the setup of OpenSim's inverse kinematics tool."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from posefuse.io.opensim.documents import add, add_objects, document, write_document

_ACCURACY = 1e-6


@dataclass(frozen=True)
class InverseKinematicsSetup:
    """Setup of inverse kinematics; the files are in the folder of the setup.

    Attributes:
        stem: name of the person in file names.
        span_s: first and last time.
        marker_weights: weight of each marker.
        coordinate_weights: weight of each coordinate that follows ``<stem>_reference.mot``; empty without the file.
    """

    stem: str
    span_s: tuple[float, float]
    marker_weights: Mapping[str, float]
    coordinate_weights: Mapping[str, float]


def write_setup(setup: InverseKinematicsSetup, path: Path) -> None:
    """Write a setup.

    Raises:
        FileError: if the file cannot be written.
    """
    root = document()
    tool = add(root, "InverseKinematicsTool", name=setup.stem)
    add(tool, "model_file", f"{setup.stem}.osim")
    add(tool, "constraint_weight", "Inf")
    add(tool, "accuracy", f"{_ACCURACY:g}")
    tasks = add_objects(tool, "IKTaskSet")
    for name, weight in setup.marker_weights.items():
        task = add(tasks, "IKMarkerTask", name=name)
        add(task, "apply", "true")
        add(task, "weight", f"{weight:.6g}")
    for name, weight in setup.coordinate_weights.items():
        task = add(tasks, "IKCoordinateTask", name=name)
        add(task, "apply", "true")
        add(task, "weight", f"{weight:.6g}")
        add(task, "value_type", "from_file")
    add(tool, "marker_file", f"{setup.stem}.trc")
    if setup.coordinate_weights:
        add(tool, "coordinate_file", reference_name(setup.stem))
    add(tool, "time_range", " ".join(f"{second:.6f}" for second in setup.span_s))
    add(tool, "report_errors", "true")
    add(tool, "results_directory", ".")
    add(tool, "output_motion_file", f"{setup.stem}.mot")
    write_document(root, path)


def reference_name(stem: str) -> str:
    """Return the name of the file of reference coordinates."""
    return f"{stem}_reference.mot"
