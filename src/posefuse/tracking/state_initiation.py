"""From what a short time showed of somebody to the state of an articulated body: the filter runs over that time."""

import numpy as np

from posefuse.arrays import frozen
from posefuse.kernels.tracking.predict import predict_people
from posefuse.kernels.tracking.projection import project_people
from posefuse.kernels.tracking.records import State
from posefuse.kernels.tracking.update import update_people
from posefuse.kinematics.initial_pose import aim, bones_shown, newborn
from posefuse.tracking.body_states import Sight, chosen
from posefuse.tracking.records import Evidence, Remembered
from posefuse.tracking.settings import Settings, tempering

_FIRST_ITERATIONS = 12


def begin(
    evidence: list[Evidence],
    settings: Settings,
    shape_m: np.ndarray | None = None,
    covariance: np.ndarray | None = None,
) -> tuple[State, list[Remembered], float]:
    """Fit a body to the first frame, and follow it to the last.

    Args:
        evidence: frames, oldest first.
        settings: of the tracker.
        shape_m: shape (shape,): if the body is known, else an adult's.
        covariance: shape (shape, shape): of that.

    Returns:
        The state of one person in the last frame; their states in the frames before it; and the median distance, in
        sigmas, of what counted from where it was seen in the last.
    """
    tree = settings.tree
    mean = tree.shape_m if shape_m is None else shape_m
    spread = tree.shape_covariance if covariance is None else covariance
    state = newborn(tree, evidence[0].points_m, mean, spread, settings.options.motion)
    past: list[Remembered] = []
    seen = np.zeros(len(tree.bones), dtype=bool)
    for i, each in enumerate(evidence):
        since_s = each.time_s - evidence[i - 1].time_s if i else np.inf
        if i:
            predict_people(
                np.array([since_s]), settings.decay_s, settings.power, settings.most,
                settings.options.motion.shape_walk, state,
            )  # fmt: skip
        shown = bones_shown(tree, each.points_m)
        aim(state.bones[0], shown, np.flatnonzero(~seen & (i > 0)))
        seen |= np.isfinite(shown).all(axis=1)
        put_right(state, each, settings, since_s)
        past.append(Remembered(each.number, each.time_s, chosen(state, [0]), each.rows))
    return state, past[:-1], error_sigma(state, evidence[-1], settings)


def put_right(state: State, seen: Evidence, settings: Settings, since_s: float) -> np.ndarray:
    """Update one person by what a frame shows of them.

    Args:
        state: of one person, in and out.
        seen: in the frame.
        settings: of the tracker.
        since_s: since the last frame that showed them, whose errors it shares in part; inf for the first, which says
            what it says whole and gates nothing.

    Returns:
        Which keypoints counted, shape (view, keypoint).
    """
    views, keypoints = seen.confidence.shape
    use = np.empty((1, views, keypoints), dtype=np.int64)
    rows = np.where(seen.rows >= 0, np.arange(views), -1)[None]
    labels = np.tile(np.arange(keypoints), (1, views, 1))
    first = np.isinf(since_s)
    law = settings.law._replace(gate=np.inf) if first else settings.law
    temper = tempering(np.array([since_s]), settings.options.error_memory_s)
    update_people(
        settings.cameras, settings.body, law, temper, _FIRST_ITERATIONS if first else settings.options.iterations, rows,
        labels, frozen(seen.keypoints_px), frozen(seen.confidence), state, use, np.empty(1), np.empty(1),
    )  # fmt: skip
    return use[0] == 0


def error_sigma(state: State, seen: Evidence, settings: Settings) -> float:
    """The median distance, in sigmas, of where keypoints are seen from where the body has them; inf where none is."""
    views, keypoints = seen.confidence.shape
    sight = Sight.room(1, views, keypoints)
    project_people(settings.cameras, settings.body, state, *sight.arrays)
    law = settings.law
    trust = np.where(np.isfinite(seen.confidence), seen.confidence, 1.0)
    sigma = law.scale_px[:, None] * np.maximum(trust, 0.05) ** -law.exponent
    sigma = np.hypot(sigma, law.floor_m * sight.size_px[0])
    off = np.linalg.norm(seen.keypoints_px - sight.pixels[0], axis=-1) / sigma
    return float(np.median(off[np.isfinite(off)])) if np.isfinite(off).any() else np.inf
