"""Static trial: the frames, of this or of another result, in which people stand in the neutral pose."""

import re
from pathlib import Path

import numpy as np

from posefuse.biomechanics.inverse_kinematics import PersonPoints, person_points
from posefuse.biomechanics.marker_model import MarkerModel
from posefuse.biomechanics.person_frames import model_world
from posefuse.errors import FileError, OptionsError, choices
from posefuse.io.results.open_result import open_result
from posefuse.model.reconstruction import Layer, Reconstruction

_MOST_FRAMES = 24


def static_frames(
    result: Reconstruction, model: MarkerModel, layer: Layer, verticals: np.ndarray
) -> tuple[PersonPoints | None, ...]:
    """Return the points of each person in the static trial; None for people without one.

    Args:
        result: the result, whose options name the trial.
        model: the unscaled model.
        layer: the layer whose points are used.
        verticals: shape (person, 3, 3): rotations to axes with y up.

    Raises:
        OptionsError: if the trial cannot be read, or contains none of these people.
    """
    text = result.options.subject.static
    if text is None:
        return (None,) * len(result.person_ids)
    numbers = re.fullmatch(r"(\d+):(\d+)", text)
    if numbers is None:
        return _of_other(result, model, Path(text))
    inside = (result.frame_numbers >= int(numbers[1])) & (result.frame_numbers < int(numbers[2]))
    if not inside.any():
        raise OptionsError(
            f"subject.static={text!r}: the result has no such frames; it has the frames {result.frame_numbers[0]} to "
            f"{result.frame_numbers[-1]}."
        )
    return tuple(_points(model, layer, p, inside, vertical) for p, vertical in enumerate(verticals))


def _of_other(result: Reconstruction, model: MarkerModel, path: Path) -> tuple[PersonPoints | None, ...]:
    """Return the points of another result."""
    try:
        _, other = open_result(path)
    except FileError as error:
        raise OptionsError(
            f"subject.static: {error} Give frames of this recording as START:STOP, or a result."
        ) from None
    if other.skeleton.keypoints != result.skeleton.keypoints:
        raise OptionsError(
            f"subject.static: {path} has the skeleton {other.skeleton.name!r}, but the recording has "
            f"{result.skeleton.name!r}. Detect both with the same skeleton."
        )
    if other.rig.up is None:
        raise OptionsError(f"subject.static: the up axis of {path} is unknown. Set `up` when reconstructing it.")
    single = len(result.person_ids) == 1 and len(other.person_ids) == 1
    pairs = {p: (0 if single else other.person_ids.index(name))
             for p, name in enumerate(result.person_ids) if single or name in other.person_ids}  # fmt: skip
    if not pairs:
        raise OptionsError(
            f"subject.static: {path} contains {choices(other.person_ids)}, but the recording contains "
            f"{choices(result.person_ids)}. Give people the same names."
        )
    _, layer = other.best_layer(other.options.layer)
    vertical, every = model_world(np.array(other.rig.up)), np.ones(other.n_frames, dtype=bool)
    return tuple(
        _points(model, layer, pairs[p], every, vertical) if p in pairs else None for p in range(len(result.person_ids))
    )


def _points(
    model: MarkerModel, layer: Layer, person: int, inside: np.ndarray, vertical: np.ndarray
) -> PersonPoints | None:
    """Return some frames of a person, or None if none is usable."""
    frames = np.flatnonzero(inside)
    frames = frames[np.unique(np.linspace(0, len(frames) - 1, min(_MOST_FRAMES, len(frames))).astype(int))]
    points = np.concatenate([np.asarray(layer.points_m[f : f + 1])[:, person] for f in frames])
    covariance = np.concatenate([np.asarray(layer.covariance_m2[f : f + 1])[:, person] for f in frames])
    found = person_points(model, points, covariance, vertical)
    return found.rows(found.usable) if found.usable.any() else None
