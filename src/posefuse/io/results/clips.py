"""Functions shared by animation formats: presence of a person, y-up axes, and holding of unknown rotations."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from posefuse.arrays import ranges
from posefuse.errors import ResultError
from posefuse.io.results.axes import minimal_y_up_from_world
from posefuse.model.animation_figures import Figure, Motion
from posefuse.model.detections import CHUNK_FRAMES
from posefuse.model.reconstruction import Reconstruction
from posefuse.progress import Progress, Silent, report_ranges

if TYPE_CHECKING:
    from posefuse.biomechanics.animation_figures import AnimatedFigure

BODY_TO_Y_UP = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Rotation from body axes (x forward, y left, z up) to the axes of glTF (x left, y up, z forward)."""
_NOTABLE_DEVIATION_M = 0.001
_MAX_LISTED_GAPS = 5


@dataclass(frozen=True, eq=False)
class Presence:
    """The frames in which a person is present.

    Attributes:
        present: shape (frame,), bool.
        max_deviation_m: largest distance between a joint of the animation skeleton and the model layer.
        held: names of joints that are unknown in some of these frames.
    """

    present: np.ndarray
    max_deviation_m: float
    held: tuple[str, ...]

    @property
    def first(self) -> int:
        """Index of the first frame."""
        return int(np.argmax(self.present))

    @property
    def last(self) -> int:
        """Index of the last frame."""
        return len(self.present) - 1 - int(np.argmax(self.present[::-1]))

    @property
    def gaps(self) -> list[tuple[int, int]]:
        """First and last frame indices of the intervals in between in which the person is absent."""
        inside = np.append(np.append(True, self.present[self.first : self.last + 1]), True)
        edges = np.flatnonzero(inside[1:] != inside[:-1]) + self.first
        return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


@dataclass(frozen=True, eq=False)
class Clip:
    """The motion of one person to write.

    Attributes:
        body: animation skeleton and motion of the person.
        presence: frames in which the person is present.
    """

    body: "AnimatedFigure"
    presence: Presence

    @property
    def figure(self) -> Figure:
        """The animation skeleton."""
        return self.body.figure


def clip_of(result: Reconstruction, person: str) -> Clip:
    """Return the clip of a person, who may be absent in all frames.

    Raises:
        ResultError: if there is no fitted model, or no such person.
    """
    from posefuse.biomechanics.animation_figures import figure_of_person  # compiled kernels: imported on first use

    body = figure_of_person(result, person)
    return Clip(body, presence_of(body.figure, motions(body, result)))


def check_presence(clip: Clip) -> None:
    """Check that there is motion to write.

    Raises:
        ResultError: if the person is absent in all frames.
    """
    if not clip.presence.present.any():
        raise ResultError(f"{clip.figure.person} is absent in all frames of this result: there is no motion to write.")


def presence_of(figure: Figure, motions: Iterable[Motion]) -> Presence:
    """Return the frames in which a person is present, from the motion in all ranges of frames."""
    present, deviation_m = [np.zeros(0, dtype=bool)], 0.0
    unknown = np.zeros(len(figure.joints), dtype=bool)
    for motion in motions:
        present.append(motion.there)
        deviation_m = max(deviation_m, float(motion.off_m[motion.there].max(initial=0.0)))
        unknown |= ~np.isfinite(motion.turns[motion.there]).all(axis=(0, 2, 3))
    held = tuple(joint.name for joint, some in zip(figure.joints, unknown, strict=True) if some)
    return Presence(np.concatenate(present), deviation_m, held)


def motions(
    body: "AnimatedFigure", result: Reconstruction, progress: Progress | None = None, what: str = ""
) -> Iterator[Motion]:
    """Yield the motion of an animation skeleton in consecutive ranges of frames."""
    from posefuse.biomechanics.animation_figures import animate  # compiled kernels: imported on first use

    spans = ranges(result.n_frames, CHUNK_FRAMES)
    motion_ranges = (animate(body, result, start, stop) for start, stop in spans)
    return report_ranges(motion_ranges, result.n_frames, what, progress or Silent())


def to_file_axes(result: Reconstruction, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return root positions, m, and rotations in y-up axes, shapes (frame, 3) and (frame, joint, 3, 3)."""
    turn = minimal_y_up_from_world(result.rig.up_axis)
    turns = BODY_TO_Y_UP @ motion.turns @ BODY_TO_Y_UP.T
    turns[:, 0] = turn @ motion.turns[:, 0] @ BODY_TO_Y_UP.T
    return motion.root_m @ turn.T, turns


def rest_root_m(figure: Figure) -> np.ndarray:
    """Return the root's position in the rest pose standing on the floor at the origin, shape (3,), m, y up."""
    return np.array([0.0, -float(figure.rest_m[:, 2].min()), 0.0])


def hold_unknown(turns: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Replace unknown rotations by those of the previous frame.

    Args:
        turns: shape (frame, joint, 3, 3), NaN where unknown.
        before: shape (joint, 3, 3): rotations of the frame before the first, without NaN.
    """
    known = np.isfinite(turns).all(axis=(2, 3))
    if known.all():
        return turns
    frames = np.arange(len(turns))[:, None]
    latest = np.maximum.accumulate(np.where(known, frames, -1), axis=0)
    joints = np.arange(turns.shape[1])[None, :]
    return np.where((latest >= 0)[..., None, None], turns[np.maximum(latest, 0), joints], before)


def limitation_notes(result: Reconstruction, clip: Clip, gap_handling: str) -> Iterator[str]:
    """Yield notes on what the file of a clip does not contain, in sentences.

    Args:
        result: the result.
        clip: the motion of one person.
        gap_handling: how the format represents frames in which the person is absent.
    """
    numbers, figure, presence = result.frame_numbers, clip.figure, clip.presence
    gaps = presence.gaps
    if gaps:
        listed = [(numbers[a], numbers[b]) for a, b in gaps[:_MAX_LISTED_GAPS]]
        spans = ", ".join(f"{first}" if first == last else f"{first} to {last}" for first, last in listed)
        more = f" and {len(gaps) - _MAX_LISTED_GAPS} more" if len(gaps) > _MAX_LISTED_GAPS else ""
        yield f"{figure.person} is absent in frames {spans}{more}: {gap_handling}."
    if presence.held:
        yield (
            f"{figure.person}: {len(presence.held)} joints of hands or face are not tracked in all frames; their last "
            "pose is held."
        )
    if presence.max_deviation_m > _NOTABLE_DEVIATION_M:
        yield (
            f"{figure.person}: bones of an animation skeleton have constant lengths, so joints deviate by up to "
            f"{1000 * presence.max_deviation_m:.0f} mm from the layer model."
        )
    if result.rig.up_axis is None:
        yield f"{figure.person}: the up axis is unknown (`up`); the file's y axis is that of the calibration."
