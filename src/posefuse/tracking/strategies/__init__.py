"""Presets of the tracker, a file each; see :class:`posefuse.tracking.stages.Stages`."""

from posefuse.model.options.tracker import Preset
from posefuse.tracking.stages import Stages
from posefuse.tracking.strategies import default, specification

_PRESETS: dict[Preset, Stages] = {"posefuse": default.STAGES, "specification": specification.STAGES}


def stages_of(preset: Preset) -> Stages:
    """By name."""
    return _PRESETS[preset]
