"""Run one task with the package ``opensim`` in a process of its own: ``python worker.py REQUEST ANSWER``.

REQUEST is a JSON file with the task and its arguments, ANSWER the JSON file that this script writes. It imports nothing
of posefuse, because the libraries that OpenSim loads can conflict with those that posefuse has loaded.
"""

import json
import os
import sys
from pathlib import Path
from typing import Any

import opensim


def describe(path: str) -> dict[str, Any]:
    """Return the bodies of a model, and for each coordinate whether it is free, neither locked nor constrained."""
    model = opensim.Model(path)
    state = model.initSystem()
    bodies = [body.getName() for body in model.getBodySet()]
    return {"bodies": bodies, "free": {c.getName(): not c.isConstrained(state) for c in model.getCoordinateSet()}}


def scale(
    source: str,
    output: str,
    name: str,
    mass_kg: float | None,
    factors: dict[str, list[float]],
    markers: dict[str, tuple[str, list[float]]],
    defaults: dict[str, float],
) -> dict[str, Any]:
    """Scale the bodies of a model, replace its markers, and set the defaults of the coordinates that it has."""
    model = opensim.Model(source)
    scale_set = opensim.ScaleSet()
    for body, values in factors.items():
        one = opensim.Scale()
        one.setSegmentName(body)
        one.setScaleFactors(opensim.Vec3(*values))
        scale_set.cloneAndAppend(one)
    model.scale(model.initSystem(), scale_set, True, -1.0 if mass_kg is None else mass_kg)
    model.updMarkerSet().clearAndDestroy()
    for marker_name, (body, location) in markers.items():
        marker = opensim.Marker(marker_name, model.getBodySet().get(body), opensim.Vec3(*location))
        marker.set_fixed(True)
        model.addMarker(marker)
    coordinates = model.updCoordinateSet()
    for coordinate, value in defaults.items():
        if coordinates.contains(coordinate):
            coordinates.get(coordinate).setDefaultValue(value)
    model.setName(name)
    model.finalizeConnections()
    return {"written": bool(model.printToXML(output))}


def inverse_kinematics(setup: str, errors: str) -> dict[str, Any]:
    """Run a setup and return the root mean square marker errors of the frames, in m."""
    # The tool looks for the files of a setup in the working directory.
    os.chdir(Path(setup).parent)
    tool = opensim.InverseKinematicsTool(setup)
    if not tool.run():
        return {"error": "the tool gives no reason"}
    column = opensim.TimeSeriesTable(errors).getDependentColumn("marker_error_RMS")
    return {"rms_m": [column[i] for i in range(column.size())]}


TASKS = {"describe": describe, "scale": scale, "inverse_kinematics": inverse_kinematics}


def main(request: str, answer: str) -> None:
    """Run the task of a request and write its answer."""
    opensim.Logger.removeFileSink()
    opensim.Logger.setLevelString("off")
    task = json.loads(Path(request).read_text("utf-8"))
    try:
        found = TASKS[task["task"]](**task["arguments"])
    except RuntimeError as error:
        found = {"error": " ".join(str(error).split())[:300]}
    Path(answer).write_text(json.dumps(found), "utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
