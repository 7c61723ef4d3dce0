"""The checkpoint of a recording's reconstruction: valid for the same inputs, options and versions."""

from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from platform import python_version

from posefuse.io.checkpoints import CheckpointFolder, digest_of
from posefuse.io.netcdf import skeleton_text
from posefuse.io.open_recording import OpenedRecording
from posefuse.model.options.options import Options
from posefuse.progress import Progress


def open_checkpoint(
    folder: Path, opened: OpenedRecording, options: Options, progress: Progress, window_s: float | None = None
) -> CheckpointFolder | None:
    """Open the checkpoint of a reconstruction, and remove parts of other inputs, options or versions.

    Args:
        folder: folder of the checkpoint.
        opened: the recording.
        options: options of the reconstruction.
        progress: receives a note on the parts that are there.
        window_s: length of the windows into which a distributed reconstruction divides the recording, or None.

    Returns:
        The checkpoint; None for a short recording without a checkpoint from an earlier run.
    """
    if window_s is None and opened.detections.n_frames <= options.chunk_frames and not folder.exists():
        return None
    key = {
        "inputs": opened.digests,
        "options": asdict(options),
        "skeleton": skeleton_text(opened.detections.skeleton),
        "versions": {"python": python_version()}
        | {name: version(name) for name in ("posefuse", "numpy", "numba", "scipy")},
        "window_s": window_s,
    }
    checkpoint, removed = CheckpointFolder.opened(folder, digest_of(key))
    if removed:
        parts = f"{removed} part" if removed == 1 else f"{removed} parts"
        progress.note(f"Removed {parts} of other inputs, options or versions from {folder}.")
    elif folder.exists():
        progress.note(f"Resuming from the finished parts in {folder}.")
    return checkpoint
