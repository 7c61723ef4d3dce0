"""Weights that a detector downloads when it is first used: their files, and which of them are on this computer."""

import os
from pathlib import Path

from posefuse.detection.registry import DetectorModel


def weights_folder() -> Path:
    """Return the folder into which rtmlib downloads weights (``rtmlib.tools.file``)."""
    cache = Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")) / "rtmlib"
    return Path(os.environ.get("TORCH_HOME", cache)).expanduser() / "hub" / "checkpoints"


def missing_weights(model: DetectorModel) -> tuple[str, ...]:
    """Return the files of a model's weights that are not on this computer; a downloaded archive counts as its file."""
    folder = weights_folder()
    return tuple(
        name
        for name in model.weights
        if not (folder / name).is_file() and not (folder / name).with_suffix(".onnx").is_file()
    )
