"""The summary of a result in sentences: what was computed from which input, and how accurate it is."""

import numpy as np

from posefuse.evaluation.accuracy import Accuracy
from posefuse.evaluation.people import PeopleScores
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus
from posefuse.report.messages import message_html
from posefuse.report.people import format_event_counts, people_per_frame
from posefuse.report.summary import Summary, format_sources, layer_origin
from posefuse.skeleton.subject_words import count_subjects, subject_words


def summary_paragraphs(
    result: Reconstruction, summary: Summary, accuracy: Accuracy | PeopleScores | None, note: str
) -> str:
    """Return the summary as HTML paragraphs; ``note`` states what the 3D scene leaves out."""
    sentences = [
        *_describe_input(result, summary),
        *_describe_errors(result, summary),
        *_describe_accuracy(accuracy),
        *_describe_world(result),
        *_describe_events_and_gaps(result, summary),
        note,
    ]
    return "".join(f"<p>{message_html(sentence)}</p>" for sentence in sentences if sentence)


def _describe_input(result: Reconstruction, summary: Summary) -> list[str]:
    people, several = count_subjects(len(result.person_ids), result.skeleton), subject_words(result.skeleton)[1]
    if not result.has_identities:
        people = f"{people_per_frame(result)} (unrelated frames)"
    length = f" ({result.n_frames / result.rate_hz:.1f} s at {result.rate_hz:g} Hz)" if result.rate_hz else ""
    cameras = "1 camera" if len(result.rig) == 1 else f"{len(result.rig)} cameras"
    scope = "" if len(result.person_ids) == 1 else f"of {'tracked ' if result.has_identities else ''}{several} "
    n_with_point = _n_with_point(summary)
    sentences = [
        f"{people}, {len(result.skeleton)} keypoints ({result.skeleton.name}), {result.n_frames} frames{length}, "
        f"{cameras}.",
        f"The numbers are those of the layer {summary.layer}: {layer_origin(result, summary.layer)}.",
        f"{100 * n_with_point / max(summary.n_points, 1):.1f} % of the points {scope}have coordinates.",
    ]
    if n_with_point:
        sentences.append(f"By source: {format_sources(summary.source_counts)}.")
    return sentences


def _n_with_point(summary: Summary) -> int:
    return summary.n_points - sum(n for code, n in summary.status_counts.items() if not code.has_point)


def _describe_errors(result: Reconstruction, summary: Summary) -> list[str]:
    sentences = []
    if summary.error_px.count:
        sentences.append(
            f"The reprojection error of the used detections has a median of {summary.error_px.median:.1f} px and a "
            f"90th percentile of {summary.error_px.p90:.1f} px."
        )
    if result.unit == "m" and summary.sd_mm.count and result.noise is not None:
        sentences.append(
            f"The median estimated standard deviation of a point is {_format_length(summary.sd_mm.median)} per axis "
            f"(detection noise {result.noise.origin}: {float(np.median(result.noise.scale_px)):.1f} px)."
        )
    return sentences


def _describe_accuracy(accuracy: Accuracy | PeopleScores | None) -> list[str]:
    if not isinstance(accuracy, Accuracy):
        return []
    return [
        f"Compared with the ground truth: median error {accuracy.median_mm:.1f} mm, mean {accuracy.mpjpe_mm:.1f} mm, "
        f"{100 * accuracy.share_beyond_50_mm:.1f} % beyond 5 cm."
    ]


def _describe_world(result: Reconstruction) -> list[str]:
    sentences = []
    up = result.rig.inferred_up
    if up is not None:
        sentences.append(
            f"The up axis of the world is {result.rig.up_text}: people stand {up.angle_deg:.0f} degrees from "
            f"{up.nearest_axis}. Set it with `up`, or level the world with `align.floor='feet'`."
        )
    elif result.rig.up_axis is None and result.unit == "m":
        sentences.append("The up axis of the world is unknown, so exports are not rotated. Set it with `up`.")
    if result.unit != "m":
        sentences.append("One camera: coordinates are pixels in its image plane, not positions in the world.")
    return sentences


def _describe_events_and_gaps(result: Reconstruction, summary: Summary) -> list[str]:
    sentences = []
    if result.events and len(result.person_ids) != 1:
        sentences.append(f"Events: {format_event_counts(result.events)}.")
    missing = [(n, code) for code, n in summary.status_counts.items() if not code.has_point]
    for n, code in sorted(missing, reverse=True)[:3]:
        sentences.append(f"{n} points are missing: {PointStatus(code).sentence}.")
    return sentences


def scene_note(stride: int, n_outside: int) -> str:
    """Return what the 3D scene leaves out; empty if it shows everything.

    Args:
        stride: the scene shows every n-th frame.
        n_outside: number of points too far away to be drawn.
    """
    ending = {1: "st", 2: "nd", 3: "rd"}.get(stride % 10 if stride % 100 not in (11, 12, 13) else 0, "th")
    sentences = []
    if stride > 1:
        sentences.append(f"The scene shows every {stride}{ending} frame.")
    if n_outside:
        points = "1 distant outlier is" if n_outside == 1 else f"{n_outside} distant outliers are"
        sentences.append(f"{points} not drawn in the scene.")
    return " ".join(sentences)


def _format_length(millimeters: float) -> str:
    """Return a small length in mm or µm."""
    return f"{millimeters:.1f} mm" if millimeters >= 0.5 else f"{1000 * millimeters:.1f} µm"
