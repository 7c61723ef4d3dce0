"""Samples of frames that represent a recording."""

from dataclasses import dataclass

import numpy as np

from posefuse.model.detections import Detections
from posefuse.model.subjects import Subjects
from posefuse.model.tracks import Tracks

_LARGE_OBSERVATIONS, _LARGE_PIECES, _LARGE_FRAMES = 20_000, 10, 300
"""About 20,000 observations, spread evenly over the recording, determine the noise scale to one percent."""

_SMALL_OBSERVATIONS, _SMALL_PIECES, _SMALL_FRAMES = 5_200, 4, 60


@dataclass(frozen=True)
class Sample:
    """Frames that represent a recording.

    Attributes:
        detections: pieces of the recording, one after the other, in memory.
        tracks: assignment of detections to people in the same frames.
        starts: index of each piece's first frame in the sample.
    """

    detections: Detections
    tracks: Tracks
    starts: tuple[int, ...]


@dataclass(frozen=True)
class Samples:
    """The samples that noise estimation reads.

    Attributes:
        small: for iterations.
        large: for the final estimate.
    """

    small: Sample
    large: Sample


def sample_spans(n_frames: int, observations_per_frame: int, *, small: bool = False) -> list[tuple[int, int]]:
    """Return ranges of frames that represent a recording: all of a short one, evenly spread pieces of a long one.

    Args:
        n_frames: number of frames of the recording.
        observations_per_frame: number of keypoints times number of views.
        small: whether to return the small sample instead of the large one.
    """
    observations = _SMALL_OBSERVATIONS if small else _LARGE_OBSERVATIONS
    longest = _SMALL_FRAMES if small else _LARGE_FRAMES
    most = min(max(observations // observations_per_frame, 2 * _LARGE_PIECES), longest)
    if n_frames <= most:
        return [(0, n_frames)]
    pieces = _SMALL_PIECES if small else _LARGE_PIECES
    length = most // pieces
    starts = np.linspace(0, n_frames - length, pieces).astype(int)
    return [(int(start), int(start) + length) for start in starts]


def take_samples(detections: Detections, subjects: Subjects) -> Samples:
    """Return the small and the large sample of a recording."""
    return Samples(*(_take(detections, subjects, small=small) for small in (True, False)))


def _take(detections: Detections, subjects: Subjects, *, small: bool) -> Sample:
    spans = sample_spans(detections.n_frames, len(detections.skeleton) * detections.n_views, small=small)
    starts = np.cumsum([0, *(stop - start for start, stop in spans[:-1])])
    tracks = Tracks.concatenate([subjects.tracks(*span) for span in spans])
    return Sample(detections.pieces(spans), tracks, tuple(starts.tolist()))
