"""Single frames of separated people, and the proposals from them."""

import numpy as np

from posefuse.association.proposals import propose
from posefuse.model.cameras import CameraRig
from posefuse.model.frames import Frame
from posefuse.model.noise import NoiseModel
from posefuse.model.options.association import AssociationOptions
from posefuse.model.proposals import Proposals
from posefuse.skeleton.skeletons import find_skeleton
from posefuse.synthetic.figures import human
from posefuse.synthetic.motions import HumanMotion
from posefuse.synthetic.rigs import build_rig

SKELETON = find_skeleton("coco_17")
GROUPS = AssociationOptions()
PLACES_M = np.array([[-1.6, -1.2], [1.4, -1.0], [-1.0, 1.5], [1.2, 1.4], [0.1, 0.2], [2.0, 0.3]])


def separated_people(n: int, seed: int = 0) -> np.ndarray:
    """Return separated people, shape (n, keypoint, 3)."""
    rng = np.random.default_rng(seed)
    people = []
    for place in PLACES_M[:n]:
        figure = human(float(rng.uniform(1.6, 1.85)))
        motion = HumanMotion.random(("walk", "reach"), rng)
        points = motion.positions(figure, np.array([rng.uniform(0, 5)]))[0, figure.columns(SKELETON)]
        points[:, :2] += place - points[:, :2].mean(axis=0)
        people.append(points)
    return np.array(people)


def people_rig(cameras: int = 5) -> CameraRig:
    return build_rig("ring", cameras, "pinhole", radius_m=5.0, target_m=(0.0, 0.0, 0.9))


def noise_of(rig: CameraRig, scale_px: float = 4.0) -> NoiseModel:
    return NoiseModel(np.full(len(rig), scale_px))


def detect(
    rig: CameraRig, points_m: np.ndarray, sigma_px: float = 4.0, seed: int = 0, hidden: tuple[tuple[int, int], ...] = ()
) -> tuple[Frame, np.ndarray]:
    """Return a frame of people in random order, and each row's person; ``hidden`` (person, view) are not detected."""
    rng = np.random.default_rng(seed)
    pixels = rig.project(points_m[None])[0] + sigma_px * rng.standard_normal((len(rig), *points_m.shape[:2], 2))
    order = [[p for p in rng.permutation(len(points_m)) if (p, v) not in hidden] for v in range(len(rig))]
    frame = Frame.of_people(
        [pixels[v, order[v]] for v in range(len(rig))], [np.ones((len(each), len(SKELETON))) for each in order], 0.0
    )
    return frame, np.array([p for each in order for p in each])


def propose_in(frame: Frame, rig: CameraRig, options: AssociationOptions = GROUPS, **more) -> Proposals:
    free = more.pop("free", np.ones(len(frame.view), dtype=bool))
    return propose(rig, frame, noise_of(rig), SKELETON, free, options, **more)


def people_of_proposals(proposals: Proposals, owner: np.ndarray) -> list[set[int]]:
    """Return the people whose detections each proposal holds."""
    return [{int(owner[row]) for row in rows if row >= 0} for rows in proposals.rows]
