"""Benchmark of association in real single frames: MVOR, an operating room with three cameras.

``python -m benchmarks.mvor FOLDER``, where FOLDER holds the recordings that the tests read. It prints the results of an
oracle that associates detections by the manual annotation, of posefuse's proposals, and of the baseline; :func:`score`
compares the proposals of an associator with the truth and the oracle.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.association_scores import AssociationScores, score_association
from posefuse.association.proposals import propose
from posefuse.evaluation.matching import assign
from posefuse.model.cameras import Camera, CameraRig
from posefuse.model.detections import Detections
from posefuse.model.frames import Frame
from posefuse.model.options.association import PROPOSAL_METHODS, AssociationOptions, ProposalMethod
from posefuse.model.options.options import Options
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.reconstruct import reconstruct
from posefuse.skeleton.skeletons import Skeleton, find_skeleton

JOINTS = (
    "head", "neck", "left_shoulder", "right_shoulder", "left_hip", "right_hip", "left_elbow", "right_elbow",
    "left_wrist", "right_wrist",
)  # fmt: skip
"""Joints of the ground truth, in its order, without the last two, which have no names."""

SOURCES = {
    "head": ("nose",),
    "neck": ("left_shoulder", "right_shoulder"),
} | {name: (name,) for name in JOINTS[2:]}
"""COCO keypoints that correspond to each joint, in the data set's OpenPose file."""

COMPARED = ("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist")
"""Scored joints. Head, neck and hips are defined differently in the truth and in OpenPose: the median error of an
oracle is 0.1 m at head and neck and 0.17 m at the hips, with two and with three views."""

INTERVAL_S = 75.0
"""Time between two frames."""

SAME_PERSON_PX = 40.0
"""Maximum mean distance of the joints of a detection from those of the annotated person."""


@dataclass(frozen=True, eq=False)
class Box:
    """A person annotated in one view without 3D truth.

    Attributes:
        view: number of the view.
        person: id shared between views, -1 without one.
        corners_px: left, top, right, bottom.
    """

    view: int
    person: int
    corners_px: np.ndarray


@dataclass(frozen=True, eq=False)
class Mvor:
    """The data set; a frame is a triplet of images, and frames are 75 s apart.

    Attributes:
        rig: cameras in meters; the world is camera 1, and the up axis is unknown.
        detections: OpenPose's people, COCO's 17 keypoints.
        truth_m: by frame, shape (truth, 10, 3), the joints as :data:`JOINTS`.
        persons: by frame, shape (truth,): ids as in ``annotated``.
        annotated_px: by frame and view, person id to joints, shape (10, 2), NaN where not visible.
        boxes: by frame, people without 3D truth.
    """

    rig: CameraRig
    detections: Detections
    truth_m: list[np.ndarray]
    persons: list[np.ndarray]
    annotated_px: list[list[dict[int, np.ndarray]]]
    boxes: list[list[Box]]


def read_mvor(folder: Path) -> Mvor:
    """Read ``camma_mvor_2018.json`` and ``openpose_kps.json``."""
    data = json.loads((folder / "camma_mvor_2018.json").read_text("utf-8"))
    openpose = json.loads((folder / "openpose_kps.json").read_text("utf-8"))
    triplets = [[image["id"] for image in each["images"]] for each in data["multiview_images"]]
    place = {image: (f, v) for f, images in enumerate(triplets) for v, image in enumerate(images)}
    frame_of = {each["id"]: f for f, each in enumerate(data["multiview_images"])}
    rig = _rig(data["cameras_info"]["camParams"])
    truth = [dict[int, np.ndarray]() for _ in triplets]
    for each in data["annotations3D"]:
        joints = np.array(each["keypoints3D"]).reshape(-1, 4)[: len(JOINTS), :3] / 1000.0
        # Four people are in the file twice; the first one is used.
        truth[frame_of[each["image_ids"]]].setdefault(each["person_id"], joints)
    annotated = [[dict[int, np.ndarray]() for _ in rig.names] for _ in triplets]
    boxes = [list[Box]() for _ in triplets]
    for each in data["annotations"]:
        f, v = place[each["image_id"]]
        if each["person_id"] >= 0:
            annotated[f][v][each["person_id"]] = _pixels(each["keypoints"])[:, :2]
        if each["person_id"] not in truth[f]:
            left, top, width, height = each["bbox"]
            corners = np.array([left, top, left + width, top + height])
            boxes[f].append(Box(v, each["person_id"], corners))
    return Mvor(
        rig,
        _detections(openpose, place, len(triplets), rig),
        [np.array(list(each.values())).reshape(-1, len(JOINTS), 3) for each in truth],
        [np.array(list(each), dtype=np.int64) for each in truth],
        annotated,
        boxes,
    )


def _rig(parameters: dict[str, Any]) -> CameraRig:
    """Return cameras without distortion (images are rectified); stored poses lead from each camera to the first."""
    cameras = []
    for v, (lens, pose) in enumerate(zip(parameters["intrinsics"], parameters["extrinsics"], strict=True)):
        (fx, fy), (cx, cy) = lens["focallength"], lens["principalpoint"]
        matrix = np.array([[fx, lens["skew_value"], cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        first_from_camera = np.array(pose, dtype=np.float64).reshape(4, 4)
        first_from_camera[:3, 3] /= 1000.0
        width, height = lens["imagesize"]
        cameras.append(Camera(f"camera_{v + 1}", (width, height), matrix, np.linalg.inv(first_from_camera)))
    return CameraRig(tuple(cameras), None, "camma_mvor_2018.json", 0.001)


def _pixels(numbers: Sequence[float]) -> np.ndarray:
    """Return x, y and confidence or visibility, NaN where the latter is 0, shape (keypoint, 3)."""
    rows = np.array(numbers, dtype=np.float64).reshape(-1, 3)
    rows[rows[:, 2] == 0] = np.nan
    return rows


def _detections(openpose: list[Any], place: dict[int, tuple[int, int]], n: int, rig: CameraRig) -> Detections:
    """Return people ordered by frame and view, and within a view as in the file."""
    cells = np.array([place[each["image_id"]] for each in openpose])
    flat = cells[:, 0] * len(rig) + cells[:, 1]
    rows = np.stack([_pixels(openpose[i]["coco_keypoints"]) for i in np.argsort(flat, kind="stable")])
    counts = np.bincount(flat, minlength=n * len(rig))
    return Detections(
        skeleton=find_skeleton("coco_17"),
        view_names=rig.names,
        frame_numbers=np.arange(n),
        time_s=np.full((n, len(rig)), np.nan),
        offsets=np.concatenate([[0], np.cumsum(counts)]),
        keypoints_px=rows[..., :2],
        confidence=rows[..., 2],
        recorded=np.ones((n, len(rig)), dtype=bool),
        track_ids=np.full(len(rows), -1),
    )


def to_joints(points: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Convert a skeleton's keypoints to MVOR's ten joints, in 3D or px: (..., keypoint, n) to (..., 10, n)."""
    columns = [[skeleton.index(part) for part in parts] for parts in SOURCES.values()]
    return np.stack([points[..., each, :].mean(axis=-2) for each in columns], axis=-2)


def told_who(data: Mvor, frame: int) -> np.ndarray:
    """Return the true association: detection of each person in each view, -1 for none, shape (truth, view), int64.

    Detections are matched with the annotation of the view, one to one, by the mean distance of common joints.
    """
    chosen = np.full((len(data.persons[frame]), len(data.rig)), -1, dtype=np.int64)
    for v in range(len(data.rig)):
        detected = _detected(data, frame, v)
        annotated = data.annotated_px[frame][v]
        if not annotated or not len(detected):
            continue
        apart = np.linalg.norm(detected[None] - np.stack(list(annotated.values()))[:, None], axis=-1)
        both = np.isfinite(apart)
        mean = np.where(both, apart, 0.0).sum(axis=-1) / np.maximum(both.sum(axis=-1), 1)
        people, rows = assign(mean, (mean <= SAME_PERSON_PX) & both.any(axis=-1))
        ids = np.array(list(annotated))[people]
        for t, person in enumerate(data.persons[frame]):
            hit = np.flatnonzero(ids == person)
            chosen[t, v] = rows[hit[0]] if len(hit) else -1
    return chosen


def _detected(data: Mvor, frame: int, view: int) -> np.ndarray:
    """Return OpenPose's joints in one view, shape (person, 10, 2)."""
    cell = frame * len(data.rig) + view
    rows = slice(int(data.detections.offsets[cell]), int(data.detections.offsets[cell + 1]))
    return to_joints(np.asarray(data.detections.keypoints_px[rows]), data.detections.skeleton)


def oracle(data: Mvor) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Triangulate the detections linearly with the true association.

    Returns:
        By frame, joints of each person of the truth, shape (truth, 10, 3), NaN below two views; and the number of
        views that show each, shape (truth, 10).
    """
    points, views = [], []
    for f in range(data.detections.n_frames):
        chosen = told_who(data, f)
        pixels = np.full((*chosen.shape, len(JOINTS), 2), np.nan)
        for v in range(len(data.rig)):
            there = chosen[:, v] >= 0
            pixels[there, v] = _detected(data, f, v)[chosen[there, v]]
        points.append(linear_points(data.rig, pixels))
        views.append(np.isfinite(pixels).all(axis=-1).sum(axis=1))
    return points, views


def linear_points(rig: CameraRig, pixels: np.ndarray) -> np.ndarray:
    """Triangulate linearly (DLT): (person, view, joint, 2) to (person, joint, 3), NaN below two views."""
    projections = np.stack([camera.matrix @ camera.camera_from_world[:3] for camera in rig.cameras])
    # Rows x P2 - P0 and y P2 - P1 of each view; zeros for a view without the joint.
    seen = np.isfinite(pixels).all(axis=-1)
    known = np.where(seen[..., None], pixels, 0.0)
    rows = known[..., None] * projections[:, None, 2:] - projections[:, None, :2]
    rows = np.moveaxis(np.where(seen[..., None, None], rows, 0.0), 1, 2)
    matrices = rows.reshape(*rows.shape[:2], 2 * len(rig), 4)
    homogeneous = np.linalg.svd(matrices)[2][..., -1, :]
    enough = seen.sum(axis=1) >= 2
    points = np.full((*enough.shape, 3), np.nan)
    points[enough] = homogeneous[enough, :3] / homogeneous[enough, 3:]
    return points


def is_unannotated(data: Mvor, frame: int, points_m: np.ndarray) -> np.ndarray:
    """Return which proposals may show a person without 3D truth, shape (person,), bool.

    At least half of their joints are in boxes of such a person in two views.

    Args:
        data: the data set.
        frame: number of the frame.
        points_m: shape (person, 10, 3).
    """
    pixels = data.rig.project(points_m[None])[0]
    found = np.zeros(len(points_m), dtype=bool)
    for p in range(len(points_m)):
        n = max(int(np.isfinite(points_m[p]).all(axis=-1).sum()), 1)
        hit = [box for box in data.boxes[frame] if 2 * _inside(box, pixels[box.view, p]) >= n]
        # A box without an id may belong to any person; those with ids must belong to one person.
        unnamed = {box.view for box in hit if box.person < 0}
        named = {box.person: {b.view for b in hit if b.person == box.person} for box in hit if box.person >= 0}
        found[p] = max(len(unnamed | views) for views in (set(), *named.values())) >= 2
    return found


def _inside(box: Box, pixels: np.ndarray) -> int:
    left, top, right, bottom = box.corners_px
    x, y = pixels[:, 0], pixels[:, 1]
    return int(((x >= left) & (x <= right) & (y >= top) & (y <= bottom)).sum())


def score(data: Mvor, proposals_m: Sequence[np.ndarray]) -> AssociationScores:
    """Score an associator's proposals.

    Args:
        data: the data set.
        proposals_m: by frame, shape (person, 17, 3), COCO's keypoints; or (person, 10, 3), joints as :data:`JOINTS`.
    """
    skeleton = data.detections.skeleton
    joints = [to_joints(each, skeleton) if each.shape[1] == len(skeleton) else each for each in proposals_m]
    points, views = oracle(data)
    counted = [~is_unannotated(data, f, each) for f, each in enumerate(joints)]
    compared = [JOINTS.index(name) for name in COMPARED]
    return score_association(joints, data.truth_m, points, views, counted, compared)


def proposed(data: Mvor, method: ProposalMethod) -> list[np.ndarray]:
    """Return by frame the joints of the proposed people of all detections, shape (person, 10, 3)."""
    noise, options = default_noise(data.rig, Options()), AssociationOptions(method=method)
    found = []
    for f in range(data.detections.n_frames):
        frame = Frame.of(data.detections, f)
        people = propose(data.rig, frame, noise, data.detections.skeleton, np.ones(len(frame.view), bool), options)
        joints = to_joints(people.points_m, data.detections.skeleton)
        found.append(joints[np.isfinite(joints).all(axis=-1).any(axis=-1)])
    return found


def reconstructed(data: Mvor, options: Options) -> list[np.ndarray]:
    """Return by frame the people of a reconstruction, shape (person, 17, 3), with frames 75 s apart."""
    result = reconstruct(data.rig, data.detections.with_rate(1.0 / INTERVAL_S), options)
    points = np.asarray(result.layers["measured"].points_m)
    return [each[np.isfinite(each[..., 0]).any(axis=-1)] for each in points]


def main() -> None:
    """Print the results of the oracle, of the proposals, and of reconstructions with and without tracking."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    data = read_mvor(parser.parse_args().folder / "mvor")
    points, _ = oracle(data)
    there = [each[np.isfinite(each).all(axis=-1).any(axis=-1)] for each in points]
    print(json.dumps({"oracle": vars(score(data, there))}, indent=2))
    for method in PROPOSAL_METHODS:
        print(json.dumps({method: vars(score(data, proposed(data, method)))}, indent=2))
    for people in ("stills", "many"):
        found = reconstructed(data, Options(people=people, health="off"))
        print(json.dumps({f"reconstruct, people {people}": vars(score(data, found))}, indent=2))


if __name__ == "__main__":
    main()
