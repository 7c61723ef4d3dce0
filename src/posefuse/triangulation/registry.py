"""Triangulation methods by name."""

from importlib import import_module
from typing import Protocol

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.tracks import Tracks


class Method(Protocol):
    """What a method's file offers."""

    DEFAULT_MIN_VIEWS: int

    def solve(
        self, rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
    ) -> Layer:
        """Triangulate every keypoint of every person in a range of frames."""
        ...


def load_method(name: str) -> Method:
    """The method of a name that :data:`posefuse.model.options.triangulation.METHODS` lists; each is a module of this package."""
    return import_module(f"posefuse.triangulation.{name}")  # type: ignore[return-value]
