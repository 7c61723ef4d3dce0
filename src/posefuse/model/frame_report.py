"""The explanation of one frame: detections, people and events."""

from dataclasses import dataclass

from posefuse.model.status import PointStatus, Source
from posefuse.model.track_events import Event
from posefuse.model.tracks import TrackState


@dataclass(frozen=True)
class DetectionReport:
    """One detection of a frame.

    Attributes:
        number: index in the view, from 0.
        n_keypoints: number of keypoints; None without the 2D keypoints.
        track_id: the detector's identity, or None.
        person: assigned person, or None if unassigned.
        error_px: layer to the median distance of the person's projected points; for an unassigned detection, of the
            nearest person.
        n_used: number of its keypoints that the measured (or only) layer uses; None if unassigned.
        why: reason for the assignment, or for the lack of one.
    """

    number: int
    n_keypoints: int | None
    track_id: int | None
    person: str | None
    error_px: dict[str, float]
    n_used: int | None
    why: str


@dataclass(frozen=True)
class ViewReport:
    """Detections of one view.

    Attributes:
        name: camera name.
        detections: detections by number.
        undetected: person to the reason why the view has no detection of them.
    """

    name: str
    detections: tuple[DetectionReport, ...]
    undetected: dict[str, str]


@dataclass(frozen=True)
class LayerReport:
    """Keypoints of a person in one layer.

    Attributes:
        layer: layer name.
        n_points: number of keypoints with coordinates.
        error_px: median reprojection error, NaN without any.
        sd_mm: median standard deviation, NaN without any.
        status: status to the keypoints with this status.
        source: source to the number of points.
    """

    layer: str
    n_points: int
    error_px: float
    sd_mm: float
    status: dict[PointStatus, tuple[str, ...]]
    source: dict[Source, int]


@dataclass(frozen=True)
class PersonReport:
    """State and keypoints of a person.

    Attributes:
        name: name of the person.
        state: track state in this frame.
        since: number of the first frame in this state.
        layers: one record per layer.
    """

    name: str
    state: TrackState
    since: int
    layers: tuple[LayerReport, ...]


@dataclass(frozen=True)
class FrameReport:
    """The explanation of one frame.

    Attributes:
        number: frame number.
        time_s: time of the frame, NaN if unknown.
        views: views in the rig's order.
        people: people who are not absent.
        events: events within a second, in order.
        complete: whether the 2D keypoints were given; only then are unassigned detections included.
    """

    number: int
    time_s: float
    views: tuple[ViewReport, ...]
    people: tuple[PersonReport, ...]
    events: tuple[Event, ...]
    complete: bool
