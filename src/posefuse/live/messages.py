"""People and events in the form of a stream's output lines."""

from collections.abc import Sequence

import numpy as np

from posefuse.io.stream import numbers_or_null
from posefuse.live.measured_points import MeasuredPoints
from posefuse.model.status import PointStatus
from posefuse.model.track_events import Event
from posefuse.tracking.records import Person

_LABELS = {int(code): code.label for code in PointStatus}


def person_message(person: Person, place: int, measured: MeasuredPoints, cameras: Sequence[str]) -> dict[str, object]:
    """Return the fields of one person.

    Args:
        person: tracked person.
        place: index among the people of the frame.
        measured: triangulated points of all people.
        cameras: names of the cameras.
    """
    points = measured.points_m[place]
    return {
        "id": person.name,
        "status": person.state.name.lower(),
        "missing_s": person.missing_s,
        "views": [name for name, row in zip(cameras, person.rows.tolist(), strict=True) if row >= 0],
        "keypoints_m": numbers_or_null(points),
        "covariance_m2": numbers_or_null(measured.covariance_m2[place]),
        "keypoint_status": [_LABELS[code] for code in measured.status[place].tolist()],
        "model_m": numbers_or_null(person.points_m),
        "model_covariance_m2": numbers_or_null(
            np.where(np.isnan(person.points_m[:, :1]), np.nan, person.covariance_m2)
        ),
    }


def event_messages(events: Sequence[Event]) -> list[dict[str, str]]:
    """Return the fields of events."""
    return [{"person": event.person, "what": event.what, "why": event.why} for event in events]
