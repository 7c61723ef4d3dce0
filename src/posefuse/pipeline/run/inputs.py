"""Digests of the inputs of a run, which the project file lists."""

from dataclasses import replace

from posefuse.errors import RecordingError
from posefuse.io.open_recording import digest_path
from posefuse.model.options.run import RunInputs, RunOptions
from posefuse.pipeline.run.plan import RunPlan


def with_inputs(plan: RunPlan) -> RunOptions:
    """Return the choices of a plan with the digests of all files that it names, but those of the board.

    Raises:
        RecordingError: if two views have the same content.
    """
    found = _digests(plan)
    views: dict[str, str] = {}
    for file in plan.choices.files_of_views.values():
        other = views.setdefault(found[file], file)
        if other != file:
            raise RecordingError(f"{other} and {file} are the same video. Remove one of them.")
    digests = tuple(f"{file}={digest}" for file, digest in found.items())
    return replace(plan.choices, inputs=RunInputs(digests))


def compare_inputs(plan: RunPlan, run: RunOptions) -> tuple[str, ...]:
    """Return a sentence if the inputs differ from those that a project file lists."""
    stated = run.inputs.digests
    if not stated or plan.problems:
        return ()
    own = _digests(plan)
    changed = [name for name, digest in stated.items() if own.get(name) != digest]
    if not changed:
        return ()
    return (f"Not the files from which the project file was written: {', '.join(changed)}. Results will differ.",)


def _digests(plan: RunPlan) -> dict[str, str]:
    run = plan.choices
    files = [*run.files_of_views.values()]
    named = (run.keypoints, run.timestamps, run.intrinsics, run.calibration_file, run.sync_file)
    files += [text for text in named if text is not None]
    return {file: digest_path(plan.path(file)) for file in dict.fromkeys(files)}
