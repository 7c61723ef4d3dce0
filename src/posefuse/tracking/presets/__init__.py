"""Presets of the tracker, a file each; see :class:`posefuse.tracking.stages.Stages`."""

from posefuse.model.tracker_options import Preset
from posefuse.tracking.presets import specification, usual
from posefuse.tracking.stages import Stages

_PRESETS: dict[Preset, Stages] = {"posefuse": usual.STAGES, "specification": specification.STAGES}


def stages_of(preset: Preset) -> Stages:
    """By name."""
    return _PRESETS[preset]
