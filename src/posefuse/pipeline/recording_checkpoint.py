"""The checkpoint of a recording's reconstruction: valid for the same inputs, options and versions."""

from pathlib import Path

from posefuse.io.checkpoints import CheckpointFolder
from posefuse.io.open_recording import OpenedRecording
from posefuse.model.options.options import Options
from posefuse.pipeline.fingerprints import recording_keys
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
    key = recording_keys(opened.digests, options, window_s=window_s).parts
    checkpoint, removed = CheckpointFolder.opened(folder, key)
    if removed:
        parts = f"{removed} part" if removed == 1 else f"{removed} parts"
        progress.note(f"Removed {parts} of other inputs, options or versions from {folder}.")
    elif folder.exists():
        progress.note(f"Resuming from the finished parts in {folder}.")
    return checkpoint
