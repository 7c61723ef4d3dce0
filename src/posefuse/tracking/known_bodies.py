"""Bodies that are known from elsewhere, by the detections that are theirs: for one who goes on with somebody's work."""

from dataclasses import dataclass

import numpy as np

from posefuse.kernels.articulated import State
from posefuse.tracking.parts import KnownShape, PartFollower
from posefuse.tracking.records import Track

_SAME_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class KnownBody:
    """The lengths of somebody's body, and of each of its parts, as they were kept; None of a part that was not.

    Attributes:
        body: of the body.
        parts: in the order of the skeleton's.
    """

    body: KnownShape
    parts: tuple[KnownShape | None, ...]


@dataclass(frozen=True, eq=False)
class KnownBodies:
    """Whose bodies are known, and which detections are theirs.

    Attributes:
        numbers: shape (frame,), int64, ascending: of frames.
        rows: shape (frame, person, view): theirs of each frame's detections, -1 for none.
        bodies: of each person.
    """

    numbers: np.ndarray
    rows: np.ndarray
    bodies: tuple[KnownBody, ...]

    def of(self, number: int, rows: np.ndarray) -> KnownBody | None:
        """Of who has most of some detections of a frame, shape (view,); None of somebody who is not known."""
        place = int(np.searchsorted(self.numbers, number))
        if not self.bodies or place == len(self.numbers) or self.numbers[place] != number:
            return None
        both = (self.rows[place] >= 0) & (rows >= 0)
        same = (both & (self.rows[place] == rows)).sum(axis=1)
        best = int(same.argmax())
        return self.bodies[best] if same[best] > _SAME_SHARE * both[best].sum() else None


def kept_body(track: Track, followers: tuple[PartFollower, ...]) -> KnownBody | None:
    """What is kept of somebody's lengths; None while those of the body are sought."""
    if track.trusted is None or not np.isfinite(track.settled_s):
        return None
    shapes = (follower.known.get(track.name) for follower in followers)
    parts = tuple(shape if shape is not None and shape.is_kept else None for shape in shapes)
    return KnownBody(KnownShape(*track.trusted, track.sought_s, is_kept=True), parts)


def tell_body(
    known: KnownBody, track: Track, state: State, p: int, time_s: float, followers: tuple[PartFollower, ...]
) -> None:
    """Let somebody who is new have a body that is known.

    Args:
        known: the body.
        track: theirs, in and out.
        state: in and out.
        p: their place in it.
        time_s: of the frame.
        followers: of parts, in and out.
    """
    n, h = state.velocity.shape[1], state.shape.shape[1]
    track.trusted = (known.body.shape_m, known.body.covariance_m2)
    track.sought_s, track.settled_s = known.body.sought_s, time_s
    state.shape[p] = known.body.shape_m
    state.free[p] = 0
    state.covariance[p, n : n + h] = 0.0
    state.covariance[p, :, n : n + h] = 0.0
    for follower, shape in zip(followers, known.parts, strict=True):
        if shape is not None:
            follower.known[track.name] = shape
