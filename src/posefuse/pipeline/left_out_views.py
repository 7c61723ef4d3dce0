"""Score the layers of a recording: predict the detections of views that are left out.

In a sample of frames, each view is left out in turn, all layers are computed from the other views, and their points are
projected into the view. The assignment of detections to people, the noise, the priors of motion and bones, and the
lengths of bodies are those of the whole recording. The same points show how far keypoints deviate from the bodies.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from posefuse.association.one_subject import SingleSubject
from posefuse.errors import PosefuseError
from posefuse.model.cameras import CameraRig
from posefuse.model.layer_scores import LayerScore, describe_scores
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import LAYERS, Reconstruction
from posefuse.model.subjects import FixedSubjects
from posefuse.model.tracks import Tracks, TrackState
from posefuse.parallel import ONE_JOB, Jobs
from posefuse.pipeline.measured_layer import measure
from posefuse.pipeline.people.deviation_choice import (
    LeftOutSample,
    choices_m,
    chosen_deviations,
    describe_deviations,
)
from posefuse.pipeline.people.left_out_bodies import Bodies
from posefuse.pipeline.people.stills import STILLS
from posefuse.pipeline.plan import Plan
from posefuse.pipeline.solved_layer import FrameWindow, LayerSolver, clock_of

_MIN_VIEWS = 3
"""With one of two views left out, nothing can be triangulated. To leave out a view for a moment only shows which layer
follows the lasting errors of the detector: judged by a third camera, this chooses the worse layer in 9 of 15 cases."""

_TWO_VIEWS = (
    "Left-out views cannot be predicted with two cameras, so the layers are not compared. The default layer is the "
    "most processed one."
)

_MAX_VIEWS = 6
_MIN_SPANS, _MAX_SPANS, _SPAN_S, _MARGIN_S = 2, 4, 1.0, 0.35
_MIN_SPAN, _MAX_SPAN = 8, 40
_MAX_OBSERVED = 1000
"""Upper bound of frames times people times views that are left out."""

_MIN_ERROR_PX = 1e-3
"""Smaller errors are rounding."""

_MIN_CONFIDENCE = 0.2
"""Detections with a lower confidence are not compared."""


@dataclass(frozen=True)
class Span:
    """A range of frames to predict, with a margin on either side.

    Attributes:
        first: index of the first frame of the margin.
        start: index of the first frame to predict.
        stop: index after the last frame to predict.
        last: index after the last frame of the margin.
    """

    first: int
    start: int
    stop: int
    last: int


def with_layer_scores(plan: Plan, jobs: Jobs = ONE_JOB) -> Plan:
    """Return the plan with scores of the layers of its result, deviations of keypoints from bodies, and notes of both.

    With one layer, no people or unrelated frames there is nothing to compare, and the plan is returned unchanged. With
    two views it has a note instead of scores.

    Args:
        plan: plan of the reconstruction.
        jobs: processes that leave out views.
    """
    bodies = Bodies.of(plan.bodies or plan.subjects, plan.options)
    people = plan.subjects.tracks(0, 0).person_ids
    if (plan.solver is None and bodies is None) or not people or plan.options.people == STILLS:
        return plan
    if len(plan.rig) < _MIN_VIEWS:
        return replace(plan, provenance=plan.provenance.with_notes([_TWO_VIEWS]))
    errors, samples = _errors_px(plan, bodies, jobs)
    notes, deviation_sd_m = [], None
    if bodies is not None:
        errors["model"], deviation_sd_m = _with_deviations(bodies, samples)
        notes.append(describe_deviations(bodies.skeleton, deviation_sd_m))
    scores = _scores(errors, len(plan.rig) - 1)
    notes.append(describe_scores(scores))
    provenance = plan.provenance.with_notes(note for note in notes if note)
    return replace(plan, layer_scores=scores, deviation_sd_m=deviation_sd_m, provenance=provenance)


def _with_deviations(bodies: Bodies, samples: list[LeftOutSample]) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors of the model layer with deviations, and the standard deviations of these, shape (keypoint,).

    For the errors in a view, deviations are chosen by the other views.
    """
    sds_m = choices_m(bodies.skeleton)
    every = [(sample.view, sample.errors_px(sds_m)) for sample in samples]
    by_others = {
        left_out: chosen_deviations(bodies.skeleton, [each for each in every if each[0] != left_out])
        for left_out in {sample.view for sample in samples}
    }
    errors = [np.take_along_axis(each, by_others[view][None, None, None], axis=0)[0] for view, each in every]
    return np.concatenate(errors), sds_m[chosen_deviations(bodies.skeleton, every)]


def sample_spans(plan: Plan, n_left_out: int) -> list[Span]:
    """Return ranges of frames that represent a recording, which depend on its length, views and people only."""
    n_frames, period_s = plan.detections.n_frames, clock_of(plan.detections).period_s
    most = int(_MAX_OBSERVED / (n_left_out * _people_present(plan)))
    margin = min(round(_MARGIN_S / period_s), _MAX_SPAN)
    # Frames of margins show nothing but take as long as others. Errors last a quarter of a second, so a span twice as
    # long has nearly as many independent ones as two spans.
    number = min(_MAX_SPANS, max(most // max(2 * margin, 1), _MIN_SPANS))
    length = min(max(round(_SPAN_S / period_s), _MIN_SPAN), _MAX_SPAN, max(most // number, _MIN_SPAN))
    number = min(number, max(n_frames // (length + 2 * margin), 1))
    if number == 1:
        length = min(n_frames, max(length, most))
    # Spans lie in the middle of equal parts of the recording.
    centers = (np.arange(number) + 0.5) * n_frames / number
    spans = []
    for center in centers:
        start = max(int(center - 0.5 * length), 0)
        stop = min(start + length, n_frames)
        spans.append(Span(max(start - margin, 0), start, stop, min(stop + margin, n_frames)))
    return spans


def _people_present(plan: Plan) -> float:
    """Return the mean number of people in a frame, at least 1."""
    if isinstance(plan.subjects, SingleSubject):
        return 1.0
    state = np.asarray(plan.subjects.tracks(0, plan.detections.n_frames).state)
    return max(float((state == TrackState.ACTIVE).sum(axis=1).mean()), 1.0)


def _left_out(n_views: int) -> list[int]:
    """Return the views to leave out: all, or some of many, evenly spread."""
    number = min(n_views, _MAX_VIEWS)
    return [int((i + 0.5) * n_views / number) for i in range(number)]


@dataclass(frozen=True, eq=False)
class _LeftOut:
    """A range of frames in which a view is left out.

    Attributes:
        plan: plan of the range and its margin, with all views.
        solver: computes the solved layer of the same frames, or None.
        bodies: bodies to fit, or None.
        inside: frames of the range.
        view: the view.
    """

    plan: Plan
    solver: LayerSolver | None
    bodies: Bodies | None
    inside: slice
    view: int


def _errors_px(
    plan: Plan, bodies: Bodies | None, jobs: Jobs
) -> tuple[dict[LayerName, np.ndarray], list[LeftOutSample]]:
    """Predict the detections of left-out views.

    Returns:
        Prediction errors by layer, shape (sample, person, keypoint), NaN without detection or point, and, if there are
        bodies, the points that predict them.
    """
    found: dict[LayerName, list[np.ndarray]] = {}
    samples: list[LeftOutSample] = []
    for errors, sample in jobs.in_order(_predict_left_out, _pieces(plan, bodies)):
        for name, error in errors.items():
            found.setdefault(name, []).append(error)
        if sample is not None:
            samples.append(sample)
    return {name: np.concatenate(parts) for name, parts in found.items()}, samples


def _pieces(plan: Plan, bodies: Bodies | None) -> Iterator[_LeftOut]:
    """Yield each view to leave out of each range of the sample."""
    left_out = _left_out(len(plan.rig))
    for span in sample_spans(plan, len(left_out)):
        part = replace(
            plan, detections=plan.detections.frames(span.first, span.last), bodies=None, solver=None, alignment=None,
            subjects=FixedSubjects(plan.subjects.tracks(span.first, span.last)), agreement=None, sample_m=None,
        )  # fmt: skip
        inside = slice(span.start - span.first, span.stop - span.first)
        solver = plan.solver
        if solver is not None:
            solver = replace(solver, steps=tuple(step.frames(span.first, span.last) for step in solver.steps))
        for view in left_out:
            yield _LeftOut(part, solver, bodies, inside, view)


def _predict_left_out(piece: _LeftOut) -> tuple[dict[LayerName, np.ndarray], LeftOutSample | None]:
    """Return the prediction errors in the left-out view by layer, and, with bodies, the points that predict it."""
    camera, inside = piece.plan.rig.cameras[piece.view], piece.inside
    pixels = _pixels(piece.plan, piece.view)[inside]
    points, covariance = _points_without(piece)
    errors: dict[LayerName, np.ndarray] = {
        name: np.linalg.norm(camera.project(each[inside])[0] - pixels, axis=-1) for name, each in points.items()
    }
    if piece.bodies is None:
        return errors, None
    body, measured = points["model"][inside], points["measured"][inside]
    return errors, LeftOutSample(piece.view, camera, pixels, body, measured, covariance[inside])


def _pixels(plan: Plan, view: int) -> np.ndarray:
    """Return the keypoints of a view, shape (frame, person, keypoint, 2), NaN where none is certain enough."""
    detections = plan.detections
    rows = plan.subjects.tracks(0, detections.n_frames).rows(detections)[:, :, view]
    found = np.where(rows >= 0, rows, 0)
    if not len(detections.keypoints_px):
        return np.full((*rows.shape, len(detections.skeleton), 2), np.nan)
    pixels, confidence = np.asarray(detections.keypoints_px)[found], np.asarray(detections.confidence)[found]
    counts = (rows >= 0)[..., None] & ~(confidence < _MIN_CONFIDENCE)
    return np.where(counts[..., None], pixels, np.nan)


def _points_without(piece: _LeftOut) -> tuple[dict[LayerName, np.ndarray], np.ndarray]:
    """Return the points of each layer computed without a view, and the covariances of the measured ones.

    Returns:
        Points, shape (frame, person, keypoint, 3), by layer, and covariances, shape (frame, person, keypoint, 6).
    """
    plan = piece.plan
    rig, others = _others(plan.rig, piece.view)
    names = plan.detections.view_names
    detections = plan.detections.views([name for i, name in enumerate(names) if i != piece.view])
    tracks = plan.subjects.tracks(0, detections.n_frames)
    tracks = Tracks(tracks.person_ids, np.asarray(tracks.detection)[:, :, others], tracks.state)
    noise = replace(plan.noise, scale_px=plan.noise.scale_px[others])
    triangulation = replace(
        plan.options.triangulation, min_views=min(plan.options.triangulation.min_views or 2, len(rig))
    )
    part_plan = replace(
        plan, rig=rig, detections=detections, subjects=FixedSubjects(tracks), noise=noise,
        options=replace(plan.options, triangulation=triangulation),
    )  # fmt: skip
    part = measure(part_plan, 0, detections.n_frames)
    points: dict[LayerName, np.ndarray] = {"measured": np.asarray(part.layers["measured"].points_m)}
    if piece.solver is not None:
        points["solved"] = _solved(piece.solver, part_plan, part)
    if piece.bodies is not None:
        try:
            points["model"] = piece.bodies.points(rig, detections, tracks, noise)
        except PosefuseError:
            points["model"] = np.full_like(points["measured"], np.nan)
    return points, np.asarray(part.layers["measured"].covariance_m2)


def _others(rig: CameraRig, view: int) -> tuple[CameraRig, np.ndarray]:
    """Return the rig without a view, and the indices of the other views."""
    others = np.flatnonzero(np.arange(len(rig)) != view)
    return rig.select(rig.names[i] for i in others), others


def _solved(solver: LayerSolver, plan: Plan, part: Reconstruction) -> np.ndarray:
    """Return the solved points of a measured part, in which a view is missing."""
    layer = part.layers["measured"]
    for step in solver.steps:
        step = step.with_views(plan.rig, plan.detections, plan.noise)
        layer = step.apply(FrameWindow(part, 0, 0, part.n_frames), layer)
    return np.asarray(layer.points_m)


def _scores(errors: dict[LayerName, np.ndarray], predicted_by: int) -> tuple[LayerScore, ...]:
    """Return the scores of the layers over the points that all of them have, unless one has too few."""
    shares: dict[LayerName, float] = {name: _share(errors["measured"], each) for name, each in errors.items()}
    complete: list[LayerName] = [name for name in shares if LayerScore(name, 1.0, 1.0, shares[name]).is_complete]
    shared = np.all([np.isfinite(errors[name]) for name in complete], axis=0)
    scores = []
    for name in LAYERS:
        if name in errors:
            known = errors[name][shared & np.isfinite(errors[name])]
            median, mean, geometric = np.nan, np.nan, np.nan
            if known.size:
                median, mean = float(np.median(known)), float(known.mean())
                geometric = float(np.exp(np.log(np.maximum(known, _MIN_ERROR_PX)).mean()))
            scores.append(LayerScore(name, median, mean, shares[name], geometric, predicted_by))
    return tuple(scores)


def _share(measured: np.ndarray, other: np.ndarray) -> float:
    """Return which share of the measured points a layer has.

    A body that was not found in part of the sample does not count there: in the recording, it is tracked from earlier
    frames and all views. One that was not found in most of it is not judged.
    """
    has, expected = np.isfinite(other), np.isfinite(measured)
    found = expected & has.any(axis=-1, keepdims=True)
    if 2 * found.sum() < expected.sum():
        return 0.0
    return float((has & found).sum() / max(found.sum(), 1))
