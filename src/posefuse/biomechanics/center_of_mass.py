"""Estimate the center of mass of each person from segment masses, with its velocity and standard deviations."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from posefuse.arguments import checked
from posefuse.arrays import ranges
from posefuse.biomechanics.marker_model import is_human
from posefuse.biomechanics.path_velocity import Path, VelocityWindow, path_velocity
from posefuse.errors import SkeletonError
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import Source
from posefuse.skeleton.masses import Masses, default_table, mass_table
from posefuse.skeleton.skeletons import Skeleton

MIN_KNOWN_SHARE = 0.9
"""Minimum share of the mass in visible segments; with less, the center of mass is missing."""
_DIAGONAL = [0, 3, 5]
_WINDOW = 512
"""Number of frames estimated at a time, whatever the chunks of the result."""
_SHARED: dict[LayerName, float] = {"measured": 0.03, "solved": 0.14, "model": 0.1}
"""Correlation between the errors of two keypoints of a frame, by layer, measured on simulated people."""


@checked
@dataclass(frozen=True, eq=False)
class CentersOfMass:
    """Hold the centers of mass of all people.

    Attributes:
        masses: segment masses.
        layer: layer of the points.
        xyz_m: shape (frame, person, 3), NaN where too little of the body is known.
        sd_m: shape (frame, person, 3): standard deviations, without the error of the segment masses; NaN where those
            of the points are unknown.
        velocity_m_s: shape (frame, person, 3), NaN where fewer than three neighboring frames are known.
        velocity_sd_m_s: shape (frame, person, 3): standard deviations of the velocity.
        known_share: shape (frame, person): share of the mass in segments with points.
        filled_share: shape (frame, person): share of the mass in segments that use filled points.
    """

    masses: Masses
    layer: LayerName
    xyz_m: np.ndarray
    sd_m: np.ndarray
    velocity_m_s: np.ndarray
    velocity_sd_m_s: np.ndarray
    known_share: np.ndarray
    filled_share: np.ndarray


_OVER_TIME = tuple(each.name for each in fields(CentersOfMass) if each.name not in ("masses", "layer"))


@checked
def center_of_mass(result: Reconstruction) -> CentersOfMass:
    """Estimate the center of mass of every person in every frame, with its velocity and standard deviations.

    Args:
        result: its best layer, or the layer set in its options, is used, with ``subject.mass_table`` of its options.

    Raises:
        SkeletonError: if the result has no human body with all segments, or no mass table.
    """
    masses = masses_of(result)
    if masses is None:
        wanted = result.options.subject.mass_table
        reason = "`subject.mass_table` is 'none'" if wanted == "none" else "the points are in px"
        if wanted == "auto" and result.unit == "m":
            default_table(result.options.subject.sex).check(result.skeleton)
            reason = f"the skeleton {result.skeleton.name} is not that of a human"
            if not result.has_identities:
                reason = "the frames are unrelated; name a table in `subject.mass_table`"
        raise SkeletonError(f"The result has no center of mass: {reason}.")
    parts = list(centers_of_mass(result, masses))
    whole = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _OVER_TIME}
    return replace(parts[0], **whole)


def masses_of(result: Reconstruction) -> Masses | None:
    """Return the segment masses of a result's people, or None without a center of mass.

    Raises:
        SkeletonError: if the options name a table, and the skeleton lacks a segment.
    """
    subject, skeleton = result.options.subject, result.skeleton
    if result.unit != "m" or subject.mass_table == "none":
        return None
    if subject.mass_table != "auto":
        masses = mass_table(subject.mass_table)
        masses.check(skeleton)
        return masses
    masses = default_table(subject.sex)
    return masses if is_human(skeleton) and masses.fits(skeleton) and result.has_identities else None


def centers_of_mass(result: Reconstruction, masses: Masses) -> Iterator[CentersOfMass]:
    """Yield the centers of mass of consecutive ranges of frames; known segments also represent the missing ones.

    Args:
        result: its best layer, or the layer set in its options, is used.
        masses: segment masses, of which the skeleton has every segment.
    """
    name, layer = result.best_layer(result.options.layer)
    time_s = np.asarray(result.time_s) if result.has_identities else np.full(result.n_frames, np.nan)
    window = VelocityWindow.of(time_s)
    body = _Body(name, masses, _shares(result.skeleton, masses), window)
    for start, stop in ranges(result.n_frames, _WINDOW) if result.n_frames else [(0, 0)]:
        first, last = max(0, start - window.margin), min(result.n_frames, stop + window.margin)
        points, covariance, source = (
            np.asarray(array[first:last]) for array in (layer.points_m, layer.covariance_m2, layer.source)
        )
        centers = body.centers(points, np.sqrt(covariance[..., _DIAGONAL]), source == Source.FILLED, time_s[first:last])
        yield replace(centers, **{each: getattr(centers, each)[start - first : stop - first] for each in _OVER_TIME})


@dataclass(frozen=True, eq=False)
class _Body:
    """Hold what the centers of mass of all frames are estimated with.

    Attributes:
        layer: layer of the points.
        masses: segment masses.
        shares: shape (segment, keypoint): from :func:`_shares`.
        window: frames that a velocity is estimated from.
    """

    layer: LayerName
    masses: Masses
    shares: np.ndarray
    window: VelocityWindow

    def centers(self, points_m: np.ndarray, sd_m: np.ndarray, filled: np.ndarray, time_s: np.ndarray) -> CentersOfMass:
        """Return the centers of mass of a range of frames.

        Args:
            points_m: shape (frame, person, keypoint, 3).
            sd_m: standard deviations of the points, of the same shape.
            filled: shape (frame, person, keypoint): whether a point is filled.
            time_s: shape (frame,).
        """
        used, segments = self.shares != 0.0, np.array([segment.mass for segment in self.masses.segments])
        missing = np.asarray(~np.isfinite(points_m).all(axis=-1))
        known = ~(missing[:, :, None] & used).any(axis=3)
        known_share = (known * segments).sum(axis=2) / segments.sum()
        filled_share = (((filled[:, :, None] & used).any(axis=3) & known) * segments).sum(axis=2) / segments.sum()
        is_enough = known_share >= MIN_KNOWN_SHARE
        with np.errstate(divide="ignore", invalid="ignore"):
            weights = (known[..., None] * self.shares).sum(axis=2) / (known * segments).sum(axis=2)[..., None]
        weights[~is_enough] = np.nan
        xyz, rho = _weighted(weights, points_m), _SHARED[self.layer]
        own, common = _weighted(weights**2, sd_m**2), _weighted(weights, sd_m) ** 2
        sd = np.sqrt((1.0 - rho) * own + rho * common)
        group = np.where(is_enough, (known << np.arange(len(segments))).sum(axis=2), -1)
        velocity, velocity_sd = np.empty(xyz.shape), np.empty(xyz.shape)
        for p in range(xyz.shape[1]):
            path = Path(time_s, xyz[:, p], sd[:, p], group[:, p])
            velocity[:, p], velocity_sd[:, p] = path_velocity(path, self.window, self.layer)
        return CentersOfMass(self.masses, self.layer, xyz, sd, velocity, velocity_sd, known_share, filled_share)


def _weighted(weights: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return sums over keypoints, shape (frame, person, 3); values with weight 0 do not count."""
    return (weights[..., None] * np.where(weights[..., None] == 0.0, 0.0, values)).sum(axis=2)


def _shares(skeleton: Skeleton, masses: Masses) -> np.ndarray:
    """Return by how much each keypoint moves the center of mass of a segment, times the segment's mass.

    Returns:
        Shape (segment, keypoint): fractions of the body mass.
    """
    shares = np.zeros((len(masses.segments), len(skeleton)))
    for row, segment in zip(shares, masses.segments, strict=True):
        ends = segment.ends_in(skeleton)
        assert ends is not None
        for names, share in ((ends[0], 1.0 - ends[2]), (ends[1], ends[2])):
            for name in names:
                row[skeleton.index(name)] += segment.mass * share / len(names)
    return shares
