"""Record of one triangulation method: how it works, its defaults, and what it supports."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.noise import NoiseModel
from posefuse.model.options.triangulation import METHODS, TriangulationOptions
from posefuse.model.reconstruction import Layer
from posefuse.model.tracks import Tracks


class Solve(Protocol):
    """Signature of a method's solver."""

    def __call__(
        self, rig: CameraRig, detections: Detections, tracks: Tracks, noise: NoiseModel, options: TriangulationOptions
    ) -> Layer:
        """Triangulate every keypoint of every person in a range of frames.

        Args:
            rig: the cameras, in the order of the detections' views.
            detections: in memory.
            tracks: assignment of detections to people, for the same frames.
            noise: error model of the detections.
            options: ``min_views`` must be set.

        Returns:
            The measured layer: points in meters, covariances, statuses, and the status of each view.
        """
        ...


Pieces = Callable[[], Iterable[tuple[Detections, Tracks]]]
"""Returns the ranges of frames of a recording, from its first frame; one range is in memory at a time."""


class Prepare(Protocol):
    """Signature of a method's preparation, which sees the whole recording, as often as it needs to."""

    def __call__(
        self, rig: CameraRig, pieces: Pieces, noise: NoiseModel, options: TriangulationOptions
    ) -> tuple[TriangulationOptions, tuple[str, ...]]:
        """Return the resolved options and notes for the user."""
        ...


@dataclass(frozen=True)
class DebugFigure:
    """Describe a figure that shows what a method did.

    Attributes:
        path: relative path of the figure in the output folder.
        applies: whether the method has anything to show, from the rig and the resolved options.
    """

    path: str
    applies: Callable[[CameraRig, TriangulationOptions], bool]


@dataclass(frozen=True)
class Method:
    """Describe a triangulation method.

    Attributes:
        name: value of ``triangulation.method``; its sentence is in
            :data:`posefuse.model.options.triangulation.METHODS`, so that help needs no kernels.
        solve: solver of a range of frames.
        default_min_views: number of views a point needs, if the options do not set it.
        supports_left_right: whether left/right labels are corrected by default. The method must reject outlier views,
            because rejected views reveal swapped labels.
        supports_trajectory: whether a long recording of one subject is solved over time by default.
        options: record of the method's own options, or None.
        prepare: resolves options from the whole recording before the first range of frames is solved, or None.
        debug_figure: figure that shows what the method did, or None.
    """

    name: str
    solve: Solve
    default_min_views: int
    supports_left_right: bool = False
    supports_trajectory: bool = False
    options: type | None = None
    prepare: Prepare | None = None
    debug_figure: DebugFigure | None = None

    @property
    def sentence(self) -> str:
        """Return the description for ``posefuse methods``."""
        return METHODS[self.name]
