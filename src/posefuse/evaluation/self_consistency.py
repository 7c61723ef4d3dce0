"""Self-consistency of a result without ground truth: reprojection errors, bone variation, accelerations, innovations.

The filter predicts every keypoint with a covariance. The normalized innovation squared (NIS; Bar-Shalom, Li &
Kirubarajan 2001, section 5.4) is 2 per keypoint and view on average if the covariance is correct.
"""

import math
from dataclasses import dataclass

import numpy as np

from posefuse.arguments import checked
from posefuse.errors import ResultError
from posefuse.evaluation.accuracy import bone_variation, median_reprojection_px
from posefuse.evaluation.motion import accelerations_m_s2
from posefuse.model.reconstruction import Reconstruction


@dataclass(frozen=True)
class Innovations:
    """Statistics of the innovations; the expected mean is 1.

    Attributes:
        n_keypoints: number of keypoints over all views and frames.
        mean: total NIS per degree of freedom; above 1 the result is overconfident. Sensitive to gross errors.
        median: median over frames and people; robust against gross errors.
    """

    n_keypoints: int
    mean: float
    median: float


@dataclass(frozen=True)
class PersonConsistency:
    """Self-consistency of one person.

    Attributes:
        name: name of the person.
        n_frames: number of frames with points.
        missing_share: fraction of keypoints missing in these frames.
        bone_variation: as for the whole result.
        innovations: as for the whole result; None without a body model.
    """

    name: str
    n_frames: int
    missing_share: float
    bone_variation: float | None
    innovations: Innovations | None


@dataclass(frozen=True)
class SelfConsistency:
    """Self-consistency of a result.

    Attributes:
        layer: layer name.
        n_frames: number of frames.
        reprojection_median_px: median over all used observations; None without any.
        bone_variation: median over people and bones of the robust relative spread of their length over time; None
            if no bone is seen twice.
        acceleration_m_s2: median over points, including motion; NaN if none occurs in three consecutive frames.
        innovations: innovations of all people; None without a body model.
        people: one record per person.
    """

    layer: str
    n_frames: int
    reprojection_median_px: float | None
    bone_variation: float | None
    acceleration_m_s2: float
    innovations: Innovations | None
    people: tuple[PersonConsistency, ...]


@checked
def self_consistency(result: Reconstruction) -> SelfConsistency:
    """Return the self-consistency of ``options.layer`` or of the best layer.

    Raises:
        ResultError: if the frames of the result are unrelated.
    """
    if not result.has_identities:
        raise ResultError(
            "Self-consistency follows people over time, but the frames are unrelated (`people='stills'`). Evaluate the "
            "result with its ground truth."
        )
    name, layer = result.best_layer(result.options.layer)
    points = np.asarray(layer.points_m[:])
    sizes = accelerations_m_s2(points, result.time_s)
    sizes = sizes[np.isfinite(sizes)]
    people = tuple(_person(result, points, p) for p in range(len(result.person_ids)))
    variations = [person.bone_variation for person in people if person.bone_variation is not None]
    return SelfConsistency(
        layer=name,
        n_frames=result.n_frames,
        reprojection_median_px=median_reprojection_px(layer),
        bone_variation=float(np.median(variations)) if variations else None,
        acceleration_m_s2=float(np.median(sizes)) if sizes.size else math.nan,
        innovations=_innovations(result, slice(None)),
        people=people,
    )


def _person(result: Reconstruction, points_m: np.ndarray, p: int) -> PersonConsistency:
    known = np.isfinite(points_m[:, p, :, 0])
    there = known.any(axis=1)
    return PersonConsistency(
        name=result.person_ids[p],
        n_frames=int(there.sum()),
        missing_share=float(1.0 - known[there].mean()) if there.any() else math.nan,
        bone_variation=bone_variation(points_m[:, p], result.skeleton.edge_indices),
        innovations=_innovations(result, slice(p, p + 1)),
    )


def _innovations(result: Reconstruction, people: slice) -> Innovations | None:
    if result.poses is None:
        return None
    nis, dof = (np.asarray(each[:])[:, people] for each in (result.poses.nis, result.poses.nis_dof))
    some = dof > 0
    if not some.any():
        return None
    nis, dof = nis[some], dof[some]
    return Innovations(int(dof.sum()) // 2, float(nis.sum() / dof.sum()), float(np.median(nis / dof)))
