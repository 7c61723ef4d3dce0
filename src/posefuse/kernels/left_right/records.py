"""Records of the pair solve and of the assignment of left and right."""

from typing import Any, NamedTuple


class PairParameters(NamedTuple):
    """Parameters of the pair solve.

    Attributes:
        pairs: shape (pair, 2), int64: keypoints, left and right.
        rank_pairs: shape (try, 2), int64: ranks of views to combine, the most promising first.
        min_views: points with fewer agreeing views are missing (at least 2).
        full_sigma: a residual of fewer sigmas has full weight.
        none_sigma: a residual of more sigmas has weight 0; the observation does not belong to this point.
        prior_sigma: standard deviation of the motion between frames, in the unit of the world; inf treats every frame
            separately.
    """

    pairs: Any
    rank_pairs: Any
    min_views: int
    full_sigma: float
    none_sigma: float
    prior_sigma: float


class PairPoints(NamedTuple):
    """Results of the pair solve, written by the kernel; the axis of length 2 is left and right.

    Attributes:
        points: shape (person_frame, pair, 2, 3).
        covariance: shape (person_frame, pair, 2, 6): xx xy xz yy yz zz.
        status: shape (person_frame, pair, 2), int8: point codes.
        used: shape (person_frame, pair, view, 2), int8: the label of the observation that supports each point, 0 left,
            1 right, -1 none.
        view_errors_px: shape (person_frame, pair, view, 2), float32: reprojection error of that observation.
        view_codes: shape (person_frame, pair, view, 2), int8: outcome for the observation of each label.
        evidence: shape (person_frame, pair, view), float32: cost of the view as labeled minus its cost swapped, in
            squared sigmas.
        costs: shape (person_frame, pair): the bounded cost of the candidate, squared sigmas.
    """

    points: Any
    covariance: Any
    status: Any
    used: Any
    view_errors_px: Any
    view_codes: Any
    evidence: Any
    costs: Any


class PopulationSearch(NamedTuple):
    """Parameters of the population search; lengths in mm.

    Attributes:
        terms: shape (4,): weights of the terms e0 to e3 of the objective.
        separation: distance from which on the points need not be farther apart.
        initial_sd: standard deviation of the initial population.
        tolerance: the search ends when the last hops of the population were within this.
        max_iterations: or after this many rounds.
        n_agents: size of the population.
        seed: random seed.
    """

    terms: Any
    separation: float
    initial_sd: float
    tolerance: float
    max_iterations: int
    n_agents: int
    seed: int


class PairFrames(NamedTuple):
    """Points of pairs over time.

    Attributes:
        points: shape (frame, pair, 2, 3), NaN where missing.
        covariance: shape (frame, pair, 2, 6).
        odds: shape (frame, pair, view): log odds that the labels of a view are swapped relative to the order.
        time_s: shape (frame,).
    """

    points: Any
    covariance: Any
    odds: Any
    time_s: Any


class PairMemory(NamedTuple):
    """Last observation of each pair, and of its labels in each view.

    Attributes:
        points: shape (pair, 2, 3).
        covariance: shape (pair, 2, 6).
        points_s: shape (pair, 2): time of each point.
        odds: shape (pair, view): log odds of the labels.
        odds_s: shape (pair, view): time of the labels.
    """

    points: Any
    covariance: Any
    points_s: Any
    odds: Any
    odds_s: Any


class MotionSpeeds(NamedTuple):
    """Speeds of pairs, m/s.

    Attributes:
        turn: shape (pair,): speed of change of the vector between the two points.
        point: shape (pair,): speed of one point.
    """

    turn: Any
    point: Any


class LabelModel(NamedTuple):
    """Model of the labels of views.

    Attributes:
        swap_fraction: shape (view,): fraction of the time that the labels are swapped.
        forgetting_rate: shape (view,): 1/s.
        weight: shape (pair, view): weight of the labels of a pair.
    """

    swap_fraction: Any
    forgetting_rate: Any
    weight: Any


class OrientationCosts(NamedTuple):
    """Costs of the orientations of pairs.

    Attributes:
        time: shape (frame, pair, 2, 2): orientation before, orientation now.
        pair: shape (frame, pair): cost of exchanging the points of the pair.
        link: shape (frame, link): cost of exchanging only one of two linked pairs.
    """

    time: Any
    pair: Any
    link: Any


class PairBlock(NamedTuple):
    """Pairs whose orientations are decided together.

    Attributes:
        members: shape (J,), int64: pairs of the block; the first is the lowest bit of a state.
        links: shape (K,), int64: links within the block.
        link_ends: shape (K, 2), int64: the bits they connect.
    """

    members: Any
    links: Any
    link_ends: Any


class LinkModel(NamedTuple):
    """Model of linked pairs.

    Attributes:
        links: shape (link, 2), int64: pairs.
        length, length_sd: shape (link,): of the bone that connects them on each side, m.
        mean_cosine, mean_cosine_sd: shape (link,): mean and standard deviation of the cosine between their vectors.
        joint_odds: shape (link, view): log odds that the labels of both pairs swap together in a view.
    """

    links: Any
    length: Any
    length_sd: Any
    mean_cosine: Any
    mean_cosine_sd: Any
    joint_odds: Any
