"""What a result says of itself, with no truth beside it: how well its parts agree, and whether it is as sure as it may.

The filter foretells where every keypoint of a person is to be seen, and how well it knows. NIS, the squared innovation
in its own covariance (Bar-Shalom, Li & Kirubarajan 2001, section 5.4), is 2 a keypoint and view on average where that
holds.
"""

import math
from dataclasses import dataclass

import numpy as np

from posefuse.evaluation.accuracy import bone_variation, median_reprojection_px
from posefuse.evaluation.motion import accelerations_m_s2
from posefuse.model.reconstruction import Reconstruction


@dataclass(frozen=True)
class Innovations:
    """How surprising what the views showed was, by what it was expected to be: 1 where it is known as well as it says.

    Attributes:
        n_keypoints: how many keypoints of all views and frames there were.
        mean: NIS by its degrees of freedom, all together; above 1 errors are larger than said. A few gross ones count.
        median: of frames and people; these do not count.
    """

    n_keypoints: int
    mean: float
    median: float


@dataclass(frozen=True)
class PersonAccount:
    """One person of a result.

    Attributes:
        name: of the person.
        n_frames: in how many frames they have points.
        missing_share: of their keypoints in those frames.
        bone_variation: as of the whole.
        innovations: likewise; None where no body was followed.
    """

    name: str
    n_frames: int
    missing_share: float
    bone_variation: float | None
    innovations: Innovations | None


@dataclass(frozen=True)
class OwnAccount:
    """What a result says of itself.

    Attributes:
        layer: which.
        n_frames: of the result.
        reprojection_median_px: over all used observations; None where there are none.
        bone_variation: median over people and bones of the robust relative spread of their length over time; None
            where no bone is seen twice.
        acceleration_m_s2: median over points; NaN where none is seen three times in a row. The movement is in it.
        innovations: of all people; None where no body was followed.
        people: each.
    """

    layer: str
    n_frames: int
    reprojection_median_px: float | None
    bone_variation: float | None
    acceleration_m_s2: float
    innovations: Innovations | None
    people: tuple[PersonAccount, ...]


def own_account(result: Reconstruction) -> OwnAccount:
    """What a result says of itself; ``options.layer`` or its best layer."""
    name, layer = result.best_layer(result.options.layer)
    points = np.asarray(layer.points_m[:])
    sizes = accelerations_m_s2(points, result.time_s)
    sizes = sizes[np.isfinite(sizes)]
    people = tuple(_person(result, points, p) for p in range(len(result.person_ids)))
    variations = [person.bone_variation for person in people if person.bone_variation is not None]
    return OwnAccount(
        layer=name,
        n_frames=result.n_frames,
        reprojection_median_px=median_reprojection_px(layer),
        bone_variation=float(np.median(variations)) if variations else None,
        acceleration_m_s2=float(np.median(sizes)) if sizes.size else math.nan,
        innovations=_innovations(result, slice(None)),
        people=people,
    )


def _person(result: Reconstruction, points_m: np.ndarray, p: int) -> PersonAccount:
    known = np.isfinite(points_m[:, p, :, 0])
    there = known.any(axis=1)
    return PersonAccount(
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
