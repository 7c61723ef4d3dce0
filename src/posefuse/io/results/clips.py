"""What files of animated figures share: when a person is there, axes with y up, turns that stay as they were."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from posefuse.arrays import ranges
from posefuse.errors import ResultError
from posefuse.io.results.axes import least_y_up_from_world
from posefuse.model.animation_figures import Figure, Motion
from posefuse.model.detections import CHUNK_FRAMES
from posefuse.model.reconstruction import Reconstruction
from posefuse.progress import Progress, Silent, report_ranges

if TYPE_CHECKING:
    from posefuse.biomechanics.animation_figures import Body

BODY_TO_Y_UP = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""From forward, left, up to x left, y up, z forward, as glTF has it."""
_SAID_OFF_M = 0.001
_MOST_SPANS = 5


@dataclass(frozen=True, eq=False)
class Life:
    """When a person is there, in the frames of a result.

    Attributes:
        there: shape (frame,), bool.
        off_m: how far at most a keypoint of the figure is from that of the model layer.
        held: names of joints that are unknown in some of these frames.
    """

    there: np.ndarray
    off_m: float
    held: tuple[str, ...]

    @property
    def first(self) -> int:
        """The first frame, counted from 0."""
        return int(np.argmax(self.there))

    @property
    def last(self) -> int:
        """The last frame."""
        return len(self.there) - 1 - int(np.argmax(self.there[::-1]))

    @property
    def gaps(self) -> list[tuple[int, int]]:
        """First and last frames of the stretches in between in which the person is away."""
        inside = np.append(np.append(True, self.there[self.first : self.last + 1]), True)
        edges = np.flatnonzero(inside[1:] != inside[:-1]) + self.first
        return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


@dataclass(frozen=True, eq=False)
class Clip:
    """A person to be written.

    Attributes:
        body: their figure.
        life: when they are there.
    """

    body: "Body"
    life: Life

    @property
    def figure(self) -> Figure:
        """Their joints."""
        return self.body.figure


def clip_of(result: Reconstruction, person: str) -> Clip:
    """A person of a result, who may be there in no frame.

    Raises:
        ResultError: if no bodies were fitted, or there is no such person.
    """
    from posefuse.biomechanics.animation_figures import body_of  # compiled kernels: imported on first use

    body = body_of(result, person)
    return Clip(body, life_of(body.figure, motions(body, result)))


def must_be_there(clip: Clip) -> None:
    """Check that there is something to write.

    Raises:
        ResultError: if the person is in no frame.
    """
    if not clip.life.there.any():
        raise ResultError(
            f"{clip.figure.person} stands in no frame of this result: there is no motion to write. Write somebody else."
        )


def life_of(figure: Figure, motions: Iterable[Motion]) -> Life:
    """When a person is there, from all ranges of frames."""
    there, off_m = [np.zeros(0, dtype=bool)], 0.0
    unknown = np.zeros(len(figure.joints), dtype=bool)
    for motion in motions:
        there.append(motion.there)
        off_m = max(off_m, float(motion.off_m[motion.there].max(initial=0.0)))
        unknown |= ~np.isfinite(motion.turns[motion.there]).all(axis=(0, 2, 3))
    held = tuple(joint.name for joint, some in zip(figure.joints, unknown, strict=True) if some)
    return Life(np.concatenate(there), off_m, held)


def motions(body: "Body", result: Reconstruction, progress: Progress | None = None, what: str = "") -> Iterator[Motion]:
    """The motion of a figure in consecutive ranges of frames."""
    from posefuse.biomechanics.animation_figures import motion_of  # compiled kernels: imported on first use

    spans = ranges(result.n_frames, CHUNK_FRAMES)
    found = (motion_of(body, result, start, stop) for start, stop in spans)
    return report_ranges(found, result.n_frames, what, progress or Silent())


def in_file_axes(result: Reconstruction, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Where the root is, m, and turns, in axes of which y is up: (frame, 3) and (frame, joint, 3, 3)."""
    turn = least_y_up_from_world(result.rig.up_axis)
    turns = BODY_TO_Y_UP @ motion.turns @ BODY_TO_Y_UP.T
    turns[:, 0] = turn @ motion.turns[:, 0] @ BODY_TO_Y_UP.T
    return motion.root_m @ turn.T, turns


def standing_m(figure: Figure) -> np.ndarray:
    """Shape (3,), m, y up: where the root is when the figure at rest stands on the floor at the origin."""
    return np.array([0.0, -float(figure.rest_m[:, 2].min()), 0.0])


def kept(turns: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Turns with those that are not known as they were in the frame before.

    Args:
        turns: shape (frame, joint, 3, 3), NaN where unknown.
        before: shape (joint, 3, 3): of the frame before, known.
    """
    known = np.isfinite(turns).all(axis=(2, 3))
    if known.all():
        return turns
    frames = np.arange(len(turns))[:, None]
    latest = np.maximum.accumulate(np.where(known, frames, -1), axis=0)
    joints = np.arange(turns.shape[1])[None, :]
    return np.where((latest >= 0)[..., None, None], turns[np.maximum(latest, 0), joints], before)


def notes_on(result: Reconstruction, clip: Clip, gap_words: str) -> Iterator[str]:
    """What a file of this figure cannot say, in sentences.

    Args:
        result: whose figure it is.
        clip: of a person.
        gap_words: what the file does in frames in which the person is away.
    """
    numbers, figure, life = result.frame_numbers, clip.figure, clip.life
    if life.gaps:
        spans = ", ".join(f"{numbers[a]} to {numbers[b]}" for a, b in life.gaps[:_MOST_SPANS])
        more = f" and {len(life.gaps) - _MOST_SPANS} more" if len(life.gaps) > _MOST_SPANS else ""
        yield f"{figure.person} is away in frames {spans}{more}: {gap_words}."
    if life.held:
        yield f"{figure.person}: {len(life.held)} joints of hands or face are not followed all the time; they stay."
    if life.off_m > _SAID_OFF_M:
        yield (
            f"{figure.person}: a figure has one length for each bone; its joints are up to "
            f"{1000 * life.off_m:.0f} mm from those of the layer model."
        )
    if result.rig.up_axis is None:
        yield f"{figure.person}: which axis is up is not known (--up); the file's y is the calibration's."
