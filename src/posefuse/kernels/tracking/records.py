"""Records of articulated bodies, of their motion and of their detections.

The state of a person consists of a pose (see :mod:`posefuse.kernels.tracking.body_kinematics`), a shape, and the
velocity of the pose; its covariance has the order pose, shape, velocity.
"""

from typing import Any, NamedTuple

USED = 0


GATED = 1


UNOBSERVED = 2


class Body(NamedTuple):
    """Arrays of a tree: ``Tree.packed``, the node of each keypoint, and ``Tree.packed_limits``."""

    parents: Any
    carriers: Any
    is_bone: Any
    offsets: Any
    shape_of: Any
    signs: Any
    starts: Any
    columns: Any
    keypoint_nodes: Any
    limits: Any
    limit_axes: Any


class State(NamedTuple):
    """State of all people.

    Attributes:
        root: shape (person, 3), m.
        turns: shape (person, segment, 3, 3): segment rotations.
        bones: shape (person, bone, 3, 3): bone frames.
        shape: shape (person, shape), m.
        velocity: shape (person, pose).
        covariance: shape (person, pose + shape + pose, the same).
        free: shape (person,), int64: whether the shape is still estimated.
    """

    root: Any
    turns: Any
    bones: Any
    shape: Any
    velocity: Any
    covariance: Any
    free: Any


class Pose(NamedTuple):
    """Pose and shape of one person, as in :class:`State`.

    Attributes:
        root: shape (3,), m.
        turns: shape (segment, 3, 3): segment rotations.
        bones: shape (bone, 3, 3): bone frames.
        shape: shape (shape,), m.
    """

    root: Any
    turns: Any
    bones: Any
    shape: Any


class MotionModel(NamedTuple):
    """Motion of bodies: every number of the pose has its own Ornstein-Uhlenbeck velocity.

    Attributes:
        decay_s: shape (pose,): time constant of the velocity decay.
        power: shape (pose,): spectral density of the accelerations, units^2 / s^3.
        max_variance: shape (pose,): upper bound of the variance of each number.
        walk: variance of the random walk of each shape number, m^2 / s.
    """

    decay_s: Any
    power: Any
    max_variance: Any
    walk: float


class ProjectedKeypoints(NamedTuple):
    """Keypoints of predicted people in space and in the views.

    Attributes:
        points: shape (person, keypoint, 3); NaN if the tree has no such keypoint.
        covariance: shape (person, keypoint, 6): m^2.
        pixels: shape (person, view, keypoint, 2): NaN where a view cannot see the point.
        pixel_covariance: shape (person, view, keypoint, 3): uu, uv, vv of the predicted pixel, px^2.
        scale_px_per_m: shape (person, view, keypoint): length of a meter in px.
    """

    points: Any
    covariance: Any
    pixels: Any
    pixel_covariance: Any
    scale_px_per_m: Any


class AssignedDetections(NamedTuple):
    """Detections assigned to people.

    Attributes:
        rows: shape (person, view), int64: rows of the detections, -1 where none.
        labels: shape (person, view, keypoint), int64: the keypoint of the detection that observes each keypoint; -1
            none.
        keypoints_px: shape (row, keypoint, 2).
        confidence: shape (row, keypoint).
    """

    rows: Any
    labels: Any
    keypoints_px: Any
    confidence: Any


class UpdateResults(NamedTuple):
    """Results of an update, written by the kernel.

    Attributes:
        use: shape (person, view, keypoint), int64: USED, GATED or UNOBSERVED.
        innovation: shape (person,): squared distance of the update from the prediction, in units of the predicted
            covariance; NaN if that covariance is not positive definite: the position then becomes NaN as well, and no
            view observes the person.
        surprise: shape (person,): sum of the squared innovations of the used keypoints, each in units of its own
            covariance; expected value two per keypoint. NaN likewise.
    """

    use: Any
    innovation: Any
    surprise: Any


class KeypointGraph(NamedTuple):
    """Keypoints connected by edges.

    Attributes:
        order: shape (keypoint,), int64: keypoints, each after its parent in a spanning tree of the edges.
        parents: shape (keypoint,), int64: parent of each keypoint, -1 for none.
        core: shape (core,), int64: keypoints that locate a body.
    """

    order: Any
    parents: Any
    core: Any


class SharedAssignment(NamedTuple):
    """Assignment of detections of which some show two people.

    Attributes:
        rows: shape (track, view), int64: assigned detections, -1 for none.
        labels: shape (track, view, keypoint), int64, in and out: the keypoint of the detection that observes each
            keypoint; -1 where it is another person's.
        shared: shape (track, view), int64, written: ``rows``, and detections of others that show the person as well.
    """

    rows: Any
    labels: Any
    shared: Any


class SideGroups(NamedTuple):
    """Limbs whose sides swap together.

    Attributes:
        mirror: shape (keypoint,), int64: the partner of each keypoint on the other side.
        group_of: shape (keypoint,), int64: limb of each keypoint, -1 for none.
        n_groups: number of limbs.
    """

    mirror: Any
    group_of: Any
    n_groups: int


class MatchParameters(NamedTuple):
    """Parameters of the scores of detections.

    Attributes:
        clutter_m: size of the area in which an unrelated keypoint may lie.
        min_log_odds: lower bound of the log odds of one keypoint.
        max_keypoints: the score counts as at most this many keypoints.
        min_score: least score that counts.
    """

    clutter_m: float
    min_log_odds: float
    max_keypoints: float
    min_score: float


class DetectionScores(NamedTuple):
    """Scores of detections, written by the kernel.

    Attributes:
        scores: shape (person, row): -inf without a common keypoint.
        swapped: shape (person, row, group), int8: whether left and right of a limb would be swapped.
        swap_odds: shape (person, row, group): log odds of the swap.
    """

    scores: Any
    swapped: Any
    swap_odds: Any


class ViewSupport(NamedTuple):
    """For how long views should have shown people, and for how long they did.

    Attributes:
        expected_s, matched_s: shape (view,): time that people were due, and time that they were detected.
        unassigned_s: shape (view,): time that unassigned detections were present while people were missing.
        due: shape (view,), int64: number of people that should have been detected in this frame.
    """

    expected_s: Any
    matched_s: Any
    unassigned_s: Any
    due: Any


class ViewSilence(NamedTuple):
    """For how long views have had no data.

    Attributes:
        absent_s: shape (view,): time since its last frame.
        undetected_s: shape (view,): time without a detection although people were due.
        active_s: shape (view,): time with data while it is silent.
        silent: shape (view,), bool.
    """

    absent_s: Any
    undetected_s: Any
    active_s: Any
    silent: Any


class LeanStatistics(NamedTuple):
    """Running statistics of the inclination of body parts.

    Attributes:
        observed_s: shape (person,): total time of reliable observation.
        leans: shape (person, segment + bone): cosines between third axes and that of the trunk.
        variance: shape (person, segment + bone): variance of these cosines over time.
        trunk_axis: shape (person, 3): mean third axis of the trunk.
    """

    observed_s: Any
    leans: Any
    variance: Any
    trunk_axis: Any
