"""Annotations of one image: the people of a result projected through the lens, and the camera's detections."""

from dataclasses import dataclass

import numpy as np

from posefuse.errors import ResultError
from posefuse.model.detections import Detections
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus
from posefuse.model.tracks import TrackState
from posefuse.visualize.detection_labels import LabeledDetections, label_detections

_CHUNK_FRAMES = 256
_UNMEASURED = (PointStatus.HELD, PointStatus.FILLED)


@dataclass(frozen=True, eq=False)
class ProjectedPerson:
    """A person projected into a camera.

    Attributes:
        index: index of the person in the result.
        name: name of the person.
        pixels: shape (keypoint, 2), with lens distortion; NaN where there is no point or the camera cannot see it.
        faint: shape (keypoint,), bool: the point is held or filled, or the person is lost.
    """

    index: int
    name: str
    pixels: np.ndarray
    faint: np.ndarray


@dataclass(frozen=True, eq=False)
class Annotations:
    """Everything that is drawn on one image.

    Attributes:
        number: frame number of the recording.
        time_s: time of the frame.
        people: the projected people.
        detections: the labeled detections, or None if they are unknown.
        edges: shape (edge, 2), int64: keypoints connected by lines.
    """

    number: int
    time_s: float
    people: tuple[ProjectedPerson, ...]
    detections: LabeledDetections | None
    edges: np.ndarray


class Annotator:
    """Compute annotations frame by frame; holds only the range of frames that was requested last.

    Args:
        result: the result to draw.
        layer: the layer to draw. Detections are labeled by the layer ``measured`` if the result has it.
        detections: detections of the result's skeleton, with views in the order of its cameras.

    Raises:
        ResultError: if the result has no such layer, or comes from a single camera.
    """

    def __init__(self, result: Reconstruction, layer: LayerName, detections: Detections | None = None) -> None:
        if result.unit != "m":
            raise ResultError(
                f"This result is in {result.unit}, in the image plane of a single camera. It has no 3D points to "
                "project or view."
            )
        result.best_layer(layer)
        self._result, self.layer, self._detections = result, layer, detections
        self._label_layer: LayerName = "measured" if "measured" in result.layers else layer
        self._first = -1
        self._part = result
        self._pixels: dict[int, np.ndarray] = {}
        numbers = [] if detections is None else detections.frame_numbers.tolist()
        self._detections_frame_of = {number: index for index, number in enumerate(numbers)}

    def annotate(self, view: int, frame_index: int) -> Annotations:
        """Return the annotations of one image.

        Args:
            view: index of the camera in the rig.
            frame_index: index of the frame in the result.
        """
        frame = self._load_range(frame_index)
        part, number = self._part, int(self._part.frame_numbers[frame])
        if view not in self._pixels:
            points = np.asarray(part.layers[self.layer].points_m)
            self._pixels[view] = part.rig.cameras[view].project(points)[0]
        return Annotations(
            number,
            float(part.time_s[frame]),
            tuple(self._project_people(frame, self._pixels[view][frame])),
            self._label_detections(frame, view, number),
            part.skeleton.edge_indices,
        )

    def _load_range(self, frame_index: int) -> int:
        """Load the range that contains the frame, and return the frame's index in it."""
        first = frame_index - frame_index % _CHUNK_FRAMES
        if first != self._first:
            self._first, self._part, self._pixels = first, self._result.frames(first, first + _CHUNK_FRAMES), {}
        return frame_index - first

    def _project_people(self, frame: int, pixels: np.ndarray) -> list[ProjectedPerson]:
        part = self._part
        faint = np.isin(np.asarray(part.layers[self.layer].status)[frame], _UNMEASURED)
        if part.tracks is not None:
            faint |= (np.asarray(part.tracks.state)[frame] == TrackState.LOST)[:, None]
        visible = np.any(np.all(np.isfinite(pixels), axis=-1), axis=-1)
        return [ProjectedPerson(p, name, pixels[p], faint[p]) for p, name in enumerate(part.person_ids) if visible[p]]

    def _label_detections(self, frame: int, view: int, number: int) -> LabeledDetections | None:
        detections_frame = self._detections_frame_of.get(number)
        if self._detections is None or detections_frame is None:
            return None
        status = np.asarray(self._part.layers[self._label_layer].view_status)[frame, :, :, view]
        return label_detections(self._part, frame, view, status, self._detections, detections_frame)
