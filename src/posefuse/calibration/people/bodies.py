"""Bodies at common times: what all views observe of each person at some moments."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from posefuse.calibration.people.bearings import Bearings
from posefuse.skeleton.skeletons import Skeleton

_MIN_KEYPOINTS = 4
_RIGID_SD, _FLEXIBLE_SD, _UNKNOWN_SD = 0.04, 0.12, 0.08
_TRIED = 3


@dataclass(frozen=True, eq=False)
class BodySamples:
    """Hold the observations of bodies at some moments.

    Attributes:
        time_s: shape (sample,): true time.
        person: shape (sample,), int64.
        observed: shape (sample, view, keypoint, 10): ray, its change per second and per logarithm of the focal length,
            and its nominal standard deviation in rad; NaN where missing.
        mirror: shape (keypoint,): place of each keypoint's mirror image.
    """

    time_s: np.ndarray
    person: np.ndarray
    observed: np.ndarray
    mirror: np.ndarray

    @property
    def n_views(self) -> int:
        """Number of views."""
        return self.observed.shape[1]

    def select_views(self, views: Sequence[int]) -> "BodySamples":
        """Return the observations of some views."""
        return replace(self, observed=np.ascontiguousarray(self.observed[:, list(views)]))

    def select(self, chosen: np.ndarray) -> "BodySamples":
        """Return some samples; ``chosen`` has shape (sample,), bool."""
        observed = np.ascontiguousarray(self.observed[chosen])
        return replace(self, time_s=self.time_s[chosen], person=self.person[chosen], observed=observed)

    def swapped(self, exchanged: np.ndarray) -> "BodySamples":
        """Return the samples with exchanged sides; ``exchanged`` has shape (sample, view, keypoint), bool."""
        return replace(self, observed=np.where(exchanged[..., None], self.observed[:, :, self.mirror], self.observed))


@dataclass(frozen=True, eq=False)
class Bones:
    """Hold pairs of keypoints at a nearly constant distance.

    Attributes:
        ends: shape (bone, 2), int64: places of the keypoints.
        sd: shape (bone,): standard deviation of the logarithm of the distance.
        length: shape (bone,), int64: index of the length, which both sides share.
    """

    ends: np.ndarray
    sd: np.ndarray
    length: np.ndarray


def sample_bodies(
    views: Sequence[Bearings],
    people: Sequence[Sequence[int]],
    offset_s: np.ndarray,
    rate: np.ndarray,
    n: int,
) -> BodySamples:
    """Return bodies at evenly chosen moments that at least two views observe.

    Args:
        views: directions of all views.
        people: index of each person in every view, -1 where a view does not observe it.
        offset_s: shape (view,): true time is the offset plus the rate times the timestamp.
        rate: shape (view,).
        n: largest number of samples.
    """
    moments = np.unique(
        np.concatenate(
            [offset_s[v] + rate[v] * views[v].sample_times(_TRIED * n // len(views) + 1) for v in range(len(views))]
        )
    )
    parts = [observe_body(views, person, (moments[:, None] - offset_s) / rate) for person in people]
    observed = np.concatenate(parts)
    enough = np.isfinite(observed[..., 0]).sum(axis=2) >= _MIN_KEYPOINTS
    usable = np.flatnonzero(enough.sum(axis=1) >= 2)
    if len(usable) > n:
        usable = usable[np.unique(np.linspace(0, len(usable) - 1, n).astype(np.int64))]
    time_s, person = np.tile(moments, len(people)), np.repeat(np.arange(len(people)), len(moments))
    return BodySamples(time_s[usable], person[usable], np.ascontiguousarray(observed[usable]), views[0].mirror)


def observe_body(views: Sequence[Bearings], person: Sequence[int], time_s: np.ndarray) -> np.ndarray:
    """Return the observations of one person, shape (sample, view, keypoint, 10).

    Args:
        views: directions of all views.
        person: index of the person in every view, or -1.
        time_s: shape (sample, view): timestamps.
    """
    out = np.full((len(time_s), len(views), len(views[0].keypoints), 10), np.nan)
    for v, view in enumerate(views):
        if person[v] < 0:
            continue
        rays, velocity, sigma = view.at(time_s[:, v], person[v])
        out[:, v, :, :3], out[:, v, :, 3:6], out[:, v, :, 9] = rays, velocity, sigma
        out[:, v, :, 6:9] = focal_changes(rays)
        out[:, v][~np.isfinite(rays[..., 0])] = np.nan
    return out


def focal_changes(rays: np.ndarray) -> np.ndarray:
    """Return the change of rays, shape (..., 3), per logarithm of the focal length of a pinhole camera."""
    off_axis = rays * np.array([1.0, 1.0, 0.0])
    return rays * (off_axis**2).sum(axis=-1, keepdims=True) - off_axis


def bones_of(skeleton: Skeleton, keypoints: np.ndarray) -> Bones:
    """Return the bones between some keypoints.

    Args:
        skeleton: the skeleton; its rigid edges vary least.
        keypoints: shape (keypoint,): indices of the keypoints.
    """
    place = {int(k): i for i, k in enumerate(keypoints)}
    rigid = {frozenset((skeleton.index(a), skeleton.index(b))) for a, b in skeleton.rigid}
    ends: list[tuple[int, int]] = []
    sds: list[float] = []
    lengths: dict[frozenset[int], int] = {}
    index: list[int] = []
    pairs = [(int(a), int(b)) for a, b in skeleton.edge_indices]
    # Many core keypoints have no edge across the trunk, whose width and sides vary little.
    pairs += [(skeleton.index(a), skeleton.index(b)) for a, b, *_ in skeleton.plausible_m]
    for a, b in dict.fromkeys(tuple(sorted(pair)) for pair in pairs):
        if a not in place or b not in place:
            continue
        key = min(frozenset((a, b)), frozenset((int(skeleton.mirror[a]), int(skeleton.mirror[b]))), key=sorted)
        ends.append((place[a], place[b]))
        sds.append((_RIGID_SD if frozenset((a, b)) in rigid else _FLEXIBLE_SD) if rigid else _UNKNOWN_SD)
        index.append(lengths.setdefault(key, len(lengths)))
    return Bones(np.array(ends, dtype=np.int64).reshape(-1, 2), np.array(sds), np.array(index, dtype=np.int64))
