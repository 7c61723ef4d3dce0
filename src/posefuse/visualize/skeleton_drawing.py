"""What one camera should see of a result in one frame: skeletons through its lens, and what its detector saw."""

from dataclasses import dataclass

import numpy as np

from posefuse.errors import ResultError
from posefuse.model.detections import Detections
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus
from posefuse.model.tracks import TrackState
from posefuse.visualize.detection_labels import Sightings, sightings

_CHUNK_FRAMES = 256
_NOT_SEEN_HERE = (PointStatus.HELD, PointStatus.FILLED)


@dataclass(frozen=True, eq=False)
class Figure:
    """A person as one camera should see them.

    Attributes:
        person: place in the result.
        name: of the person.
        pixels: shape (keypoint, 2), through the lens; NaN where there is no point or the camera cannot see it.
        faint: shape (keypoint,), bool: no camera's measurement of this frame stands behind the point, or the person
            is lost.
    """

    person: int
    name: str
    pixels: np.ndarray
    faint: np.ndarray


@dataclass(frozen=True, eq=False)
class Sketch:
    """All that is drawn on one picture.

    Attributes:
        number: of the frame in the recording.
        time_s: of the frame.
        figures: of the people.
        sightings: of the detector, or None where its keypoints are not known.
        edges: shape (edge, 2), int64: which keypoints lines join.
    """

    number: int
    time_s: float
    figures: tuple[Figure, ...]
    sightings: Sightings | None
    edges: np.ndarray


class Sketcher:
    """Sketches of a result, frame by frame; holds one short range of frames, whichever was asked for last."""

    def __init__(self, result: Reconstruction, layer: LayerName, detections: Detections | None = None) -> None:
        """Sketches of a layer.

        Args:
            result: whose.
            layer: that is drawn; what became of detections is told of ``measured`` where it is there.
            detections: of the result's skeleton, views in the order of its cameras.

        Raises:
            ResultError: if the result has no such layer, or is of one flattened camera.
        """
        if result.unit != "m":
            raise ResultError(
                f"This result is in {result.unit}, one camera's image plane: it has no points in the world to project "
                "or to view."
            )
        result.best_layer(layer)
        self._result, self.layer, self._detections = result, layer, detections
        self._judge: LayerName = "measured" if "measured" in result.layers else layer
        self._first = -1
        self._part = result
        self._pixels: dict[int, np.ndarray] = {}
        numbers = [] if detections is None else detections.frame_numbers.tolist()
        self._place_of = {number: place for place, number in enumerate(numbers)}

    def sketch(self, view: int, place: int) -> Sketch:
        """What a camera should see.

        Args:
            view: place of the camera in the rig.
            place: of the frame in the result.
        """
        frame = self._go_to(place)
        part, number = self._part, int(self._part.frame_numbers[frame])
        if view not in self._pixels:
            points = np.asarray(part.layers[self.layer].points_m)
            self._pixels[view] = part.rig.cameras[view].project(points)[0]
        return Sketch(
            number,
            float(part.time_s[frame]),
            tuple(self._figures(frame, self._pixels[view][frame])),
            self._sightings(frame, view, number),
            part.skeleton.edge_indices,
        )

    def _go_to(self, place: int) -> int:
        """Have the frame's range in memory; its place there."""
        first = place - place % _CHUNK_FRAMES
        if first != self._first:
            self._first, self._part, self._pixels = first, self._result.frames(first, first + _CHUNK_FRAMES), {}
        return place - first

    def _figures(self, frame: int, pixels: np.ndarray) -> list[Figure]:
        part = self._part
        faint = np.isin(np.asarray(part.layers[self.layer].status)[frame], _NOT_SEEN_HERE)
        if part.tracks is not None:
            faint |= (np.asarray(part.tracks.state)[frame] == TrackState.LOST)[:, None]
        there = np.any(np.all(np.isfinite(pixels), axis=-1), axis=-1)
        return [Figure(p, name, pixels[p], faint[p]) for p, name in enumerate(part.person_ids) if there[p]]

    def _sightings(self, frame: int, view: int, number: int) -> Sightings | None:
        place = self._place_of.get(number)
        if self._detections is None or place is None:
            return None
        status = np.asarray(self._part.layers[self._judge].view_status)[frame, :, :, view]
        return sightings(self._part, frame, view, status, self._detections, place)
