"""The summary in plain words: what was computed, from what, and how good it is."""

from html import escape

import numpy as np

from posefuse.evaluation.accuracy import Accuracy
from posefuse.evaluation.people import PeopleScores
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import PointStatus
from posefuse.report.people import events_in_words
from posefuse.report.summary import Summary, sources_in_words


def in_words(result: Reconstruction, summary: Summary, accuracy: Accuracy | PeopleScores | None, shown: str) -> str:
    """The summary in plain words; ``shown`` says what the scene leaves out."""
    one, several = ("person", "people") if "left_hip" in result.skeleton.keypoints else ("subject", "subjects")
    people = f"1 {one}" if len(result.person_ids) == 1 else f"{len(result.person_ids)} {several}"
    length = f" ({result.n_frames / result.rate_hz:.1f} s at {result.rate_hz:g} Hz)" if result.rate_hz else ""
    there = summary.n_points - sum(n for code, n in summary.status_counts.items() if not code.has_point)
    cameras = "1 camera" if len(result.rig) == 1 else f"{len(result.rig)} cameras"
    whose = "" if len(result.person_ids) == 1 else f"of {several}, while they are followed, "
    sentences = [
        f"{people}, {len(result.skeleton)} keypoints ({result.skeleton.name}), {result.n_frames} frames{length}, "
        f"{cameras}, method {result.options.triangulation.method}, layer {summary.layer}.",
        f"{100 * there / max(summary.n_points, 1):.1f} % of the points {whose}have coordinates.",
    ]
    if there:
        sentences.append(f"Of these {sources_in_words(summary.source_counts)}.")
    if summary.error_px.count:
        sentences.append(
            f"Half of the used observations lie within {summary.error_px.median:.1f} px of the reprojected points, "
            f"nine in ten within {summary.error_px.p90:.1f} px."
        )
    if result.unit == "m" and summary.sd_mm.count and result.noise is not None:
        sentences.append(
            f"By its own account a typical point is known to {_length(summary.sd_mm.median)} per axis "
            f"(noise of a detection {result.noise.origin}: {float(np.median(result.noise.scale_px)):.1f} px)."
        )
    if isinstance(accuracy, Accuracy):
        sentences.append(
            f"Against the truth: median error {accuracy.median_mm:.1f} mm, mean {accuracy.mpjpe_mm:.1f} mm, "
            f"{100 * accuracy.share_beyond_50_mm:.1f} % beyond 5 cm."
        )
    if result.rig.up_axis is None and result.unit == "m":
        sentences.append("Which way is up is unknown, so nothing was rotated on export; --up says it.")
    if result.unit != "m":
        sentences.append("One camera: this is its image plane in pixels, not a place in the world.")
    if result.events and len(result.person_ids) != 1:
        sentences.append(f"Events: {events_in_words(result.events)}.")
    missing = [(n, code) for code, n in summary.status_counts.items() if not code.has_point]
    for n, code in sorted(missing, reverse=True)[:3]:
        sentences.append(f"{n} points are missing: {PointStatus(code).sentence}.")
    sentences.append(shown)
    return "".join(f"<p>{escape(sentence)}</p>" for sentence in sentences if sentence)


def scene_in_words(stride: int, strays: int) -> str:
    """What the scene leaves out; empty where it shows everything."""
    ending = {1: "st", 2: "nd", 3: "rd"}.get(stride % 10 if stride % 100 not in (11, 12, 13) else 0, "th")
    sentences = []
    if stride > 1:
        sentences.append(f"The scene below shows every {stride}{ending} frame of this long recording.")
    if strays:
        sentences.append(f"{strays} points so far out that they would dwarf the scene are not drawn in it.")
    return " ".join(sentences)


def _length(millimetres: float) -> str:
    """A small length in a unit that shows it."""
    return f"{millimetres:.1f} mm" if millimetres >= 0.5 else f"{1000 * millimetres:.1f} µm"
