"""``posefuse detector``."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from posefuse.cli.console import Bars, note, say, wrap_lines
from posefuse.errors import OptionsError


def detector(
    action: Annotated[
        Literal["install", "list", "remove"],
        Parameter(help="Install a detector, list the detectors and where they are, or remove one."),
    ] = "list",
    name: Annotated[str | None, Parameter(help="Detector to install or to remove, such as mediapipe.")] = None,
    *,
    python: Annotated[
        Path | None,
        Parameter(help="Python on which install bases the environment; by default one that fits is found."),
    ] = None,
    device: Annotated[
        Literal["auto", "cpu", "cuda"],
        Parameter(help="Device for which install chooses packages; auto is cuda where an NVIDIA GPU is."),
    ] = "auto",
) -> None:
    """Install, list or remove detectors, each in a Python environment of its own.

    The environments are in the user's cache, or in the folder POSEFUSE_HOME. Other detectors need no installation:
    a worker file or an ONNX model, see docs/detect.md.
    """
    from posefuse.detection.environments import install, remove
    from posefuse.detection.registry import find_detector

    if action == "list":
        _list_detectors()
        return
    if name is None:
        raise OptionsError(f"Name the detector: posefuse detector {action} mediapipe.")
    record = find_detector(name)[0]
    if action == "remove":
        note(f"Removed {record.name}." if remove(record) else f"{record.name} is not installed.")
        return
    found = install(record, python=python, device=device, progress=Bars())
    note(
        f"{record.name} is installed: {found.folder}, Python {found.version}, {found.size_mb} MB. Licenses: "
        f"{record.licenses}. {record.weights}"
    )
    say(f"Use it: posefuse run VIDEOS --detector {record.name} --output result")


def _list_detectors() -> None:
    from posefuse.detection.environments import environment_of
    from posefuse.detection.registry import detectors
    from posefuse.detection.weights import missing_weights

    for record in detectors():
        environment = environment_of(record)
        if environment.state == "installed":
            absent = ", weights not downloaded" if missing_weights(record.models[0]) else ""
            size = f"{absent}, {environment.size_mb} MB{', CUDA' if environment.cuda else ''}, {environment.folder}"
        else:
            size = f", {record.requirements.size_mb} MB"
        models = ", ".join(f"{record.name}:{model.name} ({model.help})" for model in record.models if model.name)
        rows = [(f"{record.name}: {environment.state}{size}", 0), (record.help, 2)]
        rows += [(f"{models}.", 2)] if models else []
        for text, indent in (*rows, (f"Licenses: {record.licenses}. {record.weights}", 2)):
            for line in wrap_lines(text, indent):
                say(line)
