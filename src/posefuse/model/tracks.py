"""Tracks: which detection of each view is assigned to which person."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import check_shape, same
from posefuse.errors import ResultError
from posefuse.kernels import status_codes
from posefuse.model.detections import Detections


class TrackState(IntEnum):
    """State of a person's track in one frame."""

    ABSENT = 0
    TENTATIVE = 1
    ACTIVE = 2
    LOST = 3


@checked
@dataclass(frozen=True, eq=False)
class Tracks:
    """Assignment of detections to people over time.

    Attributes:
        person_ids: Names of the people, in order; also the stems of per-person files.
        detection: shape (frame, person, view), int32: index of the assigned detection among those of its view and
            frame, counted from 0; -1 for none.
        state: shape (frame, person), int8, :class:`TrackState`.

    Raises:
        ResultError: If names repeat, or if the shapes of the arrays are inconsistent.
    """

    person_ids: tuple[str, ...]
    detection: np.ndarray
    state: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "person_ids", tuple(self.person_ids))
        n = len(self.person_ids)
        if len(set(self.person_ids)) != n:
            raise ResultError(f"Person IDs must be unique, got {list(self.person_ids)}.")
        check_shape(ResultError, "Tracks", "detection", self.detection, frame=None, person=n, view=None)
        check_shape(ResultError, "Tracks", "state", self.state, frame=self.detection.shape[0], person=n)

    def frames(self, start: int, stop: int) -> "Tracks":
        """Return the frames ``start`` to ``stop``, in memory."""
        return Tracks(self.person_ids, np.asarray(self.detection[start:stop]), np.asarray(self.state[start:stop]))

    def rows(self, detections: Detections) -> np.ndarray:
        """Return the rows of the detections' arrays, shape (frame, person, view), int64.

        Missing detections are NO_DETECTION or NOT_RECORDED.
        """
        starts = detections.offsets[:-1].reshape(detections.n_frames, 1, detections.n_views)
        index = np.asarray(self.detection[:]).astype(np.int64)
        missing = np.where(detections.recorded, status_codes.NO_DETECTION, status_codes.NOT_RECORDED)[:, None, :]
        return np.where(index >= 0, starts + index, missing)

    @classmethod
    def concatenate(cls, parts: Sequence["Tracks"]) -> "Tracks":
        """Return consecutive ranges of frames as one."""
        return cls(
            parts[0].person_ids,
            np.concatenate([part.detection[:] for part in parts]),
            np.concatenate([part.state[:] for part in parts]),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Tracks):
            return False
        return self.person_ids == other.person_ids and all(
            same(np.asarray(getattr(self, f.name)[:]), np.asarray(getattr(other, f.name)[:])) for f in fields(self)[1:]
        )

    __hash__ = None  # type: ignore[assignment]
