"""The report: one HTML file with everything in it, the same bytes for the same result."""

import base64
import dataclasses
import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np
from plotly.offline import get_plotlyjs

from posefuse.evaluation.accuracy import Accuracy
from posefuse.evaluation.people import PeopleScores
from posefuse.evaluation.sightings import count_misses
from posefuse.model.cameras import Camera, LensModel
from posefuse.model.options import LayerName, Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.skeletons import Skeleton
from posefuse.model.status import PointStatus, ViewStatus
from posefuse.progress import Progress, Silent, watched
from posefuse.report.people import events_in_words, life_lines, lives, people_section
from posefuse.report.summary import Summary, sources_in_words, summarise
from posefuse.report.swaps import swap_table, time_line

SHOWN_FRAMES = 1500
"""A longer recording is thinned to about this many frames for display, and the page says so."""

_SIDES_HINT = '<span class="left">Left</span>, <span class="right">right</span>'
_PEOPLE_HINT = "One colour a person, names above their heads"

_VIEW_CODES = (
    ViewStatus.USED,
    ViewStatus.USED_SWAPPED,
    ViewStatus.OUTLIER,
    ViewStatus.LOW_CONFIDENCE,
    ViewStatus.UNSEEN,
)


def render_report(
    result: Reconstruction,
    truth: Reconstruction | None = None,
    accuracy: Accuracy | PeopleScores | None = None,
    progress: Progress | None = None,
) -> str:
    """The report of a result, as the text of its HTML file.

    Args:
        result: what to show; the layer ``options.layer`` names, or the best.
        truth: known positions of the same frames and keypoints, shown beside it.
        accuracy: of the result against the truth.
        progress: told how far the work is.
    """
    layer, _ = result.best_layer(result.options.layer)
    parts = watched(result.chunks(), result.n_frames, "summarising", progress or Silent())
    summary = summarise(parts, layer)
    stride = max(1, -(-result.n_frames // SHOWN_FRAMES))
    data = {
        "scene": _scene(result, layer, truth, stride),
        "charts": _charts(result, summary),
        "swaps": time_line(result.chunks(), result.n_frames),
        "lives": life_lines(result),
    }
    several = len(result.person_ids) != 1
    misses = count_misses(result.chunks(), layer) if several else None
    return Template(_asset("report.html")).substitute(
        title=escape(f"posefuse: {len(result.person_ids)} x {result.skeleton.name}"),
        css=_asset("report.css"),
        plotly=get_plotlyjs(),
        script=_asset("report.js"),
        data=_safe_json(data),
        sides=_PEOPLE_HINT if several else _SIDES_HINT,
        people=people_section(result, lives(result.chunks(), layer), misses),
        words=_words(result, summary, accuracy, stride),
        accuracy=_accuracy_table(accuracy),
        cameras=_camera_table(result, summary),
        swaps=swap_table(result, summary),
        notes=_notes(result),
        options=_options(result.options),
        versions=escape(", ".join(f"{name} {number}" for name, number in result.provenance.versions.items())),
    )


def _asset(name: str) -> str:
    return files("posefuse.report").joinpath("assets", name).read_text("utf-8")


def _safe_json(data: Any) -> str:
    """JSON that cannot end the script element it stands in."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c").replace("&", "\\u0026")


def _scene(result: Reconstruction, layer: LayerName, truth: Reconstruction | None, stride: int) -> dict[str, Any]:
    packed = _packed(result, layer, stride)
    people = [{"name": name, "points": points} for name, points in zip(result.person_ids, packed, strict=True)]
    scene: dict[str, Any] = {
        "people": people,
        "keypoints": list(result.skeleton.keypoints),
        "edges": result.skeleton.edge_indices.tolist(),
        "sides": [_side(name) for name in result.skeleton.keypoints],
        "frames": result.frame_numbers[::stride].tolist(),
        "stride": stride,
        "rate": (result.rate_hz or 30.0) / stride,
        "up": (result.rig.up_axis or "") if result.unit == "m" else "-y",
        "unit": result.unit,
        "cameras": [] if result.unit != "m" else _frusta(result),
        "truth": None,
    }
    if (
        truth is not None
        and truth.n_frames == result.n_frames
        and truth.skeleton.keypoints == result.skeleton.keypoints
    ):
        truth_layer, _ = truth.best_layer()
        scene["truth"] = _packed(truth, truth_layer, stride)
    return scene


def _packed(result: Reconstruction, layer: LayerName, stride: int) -> list[str]:
    """Shown frames of each person as base64 of float32 (frame, keypoint, 3); NaN stays NaN."""
    shown = []
    first = 0
    for part in result.chunks():
        points = np.asarray(part.layers[layer].points_m[:])
        shown.append(points[(-first) % stride :: stride])
        first += part.n_frames
    by_person = np.concatenate(shown).astype("<f4").swapaxes(0, 1)
    return [base64.b64encode(points.tobytes()).decode("ascii") for points in by_person]


def _side(name: str) -> str:
    if "left" in name:
        return "left"
    return "right" if "right" in name else "middle"


def _frusta(result: Reconstruction) -> list[dict[str, Any]]:
    """The cameras, drawn as large as suits how far apart they stand."""
    centres = np.array([camera.centre_m for camera in result.rig.cameras])
    spread = float(np.median(np.linalg.norm(centres - np.median(centres, axis=0), axis=-1)))
    return [_frustum(camera, 0.1 * spread or 0.4) for camera in result.rig.cameras]


def _frustum(camera: Camera, depth_m: float) -> dict[str, Any]:
    """A camera as a pyramid: its centre and the world points of the image's corners, a little in front of it."""
    width, height = camera.size_px
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64)
    rays, _ = camera.rays(corners)
    if camera.lens is LensModel.FISHEYE or not np.isfinite(rays).all():
        half = np.tan(np.radians(35))
        rays = np.array([[-half, -half, 1], [half, -half, 1], [half, half, 1], [-half, half, 1]])
    points = camera.centre_m + (depth_m * rays / rays[:, 2:]) @ camera.rotation
    return {"name": camera.name, "centre": _rounded(camera.centre_m), "corners": [_rounded(point) for point in points]}


def _rounded(values: np.ndarray) -> list[float]:
    return [round(float(value), 4) for value in values]


def _charts(result: Reconstruction, summary: Summary) -> dict[str, Any]:
    observations = summary.view_status_counts.sum(axis=1, keepdims=True)
    shares = summary.view_status_counts / np.maximum(observations, 1)
    order = list(ViewStatus)
    named = {code.label.replace("_", " "): shares[:, order.index(code)].round(5).tolist() for code in _VIEW_CODES}
    others = 1.0 - sum(shares[:, order.index(code)] for code in _VIEW_CODES)
    return {
        "views": list(result.rig.names),
        "view_median": _numbers([spread.median for spread in summary.error_px_by_view]),
        "view_p90": _numbers([spread.p90 for spread in summary.error_px_by_view]),
        "view_shares": named | {"other": np.maximum(others, 0.0).round(5).tolist()},
        "keypoints": list(result.skeleton.keypoints),
        "keypoint_median": _numbers([spread.median for spread in summary.error_px_by_keypoint]),
        "keypoint_p90": _numbers([spread.p90 for spread in summary.error_px_by_keypoint]),
        "keypoint_groups": _keypoint_groups(result.skeleton),
        "keypoint_missing": summary.missing_by_keypoint.round(5).tolist(),
    }


def _keypoint_groups(skeleton: Skeleton) -> list[list[Any]]:
    """Names of the body and of its hands and faces, each with the places of its keypoints; a keypoint is in one."""
    taken: set[int] = set()
    groups: list[list[Any]] = []
    for part in skeleton.parts:
        mine = [int(k) for k in part.keypoints if int(k) not in taken]
        groups.append([part.name.replace("_", " "), mine])
        taken.update(mine)
    rest = [k for k in range(len(skeleton)) if k not in taken]
    return [["body", rest], *groups] if rest else groups


def _numbers(values: Sequence[float]) -> list[float | None]:
    return [round(value, 4) if np.isfinite(value) else None for value in values]


def _words(result: Reconstruction, summary: Summary, accuracy: Accuracy | PeopleScores | None, stride: int) -> str:
    """The summary in plain words."""
    people = "1 person" if len(result.person_ids) == 1 else f"{len(result.person_ids)} people"
    length = f" ({result.n_frames / result.rate_hz:.1f} s at {result.rate_hz:g} Hz)" if result.rate_hz else ""
    there = summary.n_points - sum(n for code, n in summary.status_counts.items() if not code.has_point)
    cameras = "1 camera" if len(result.rig) == 1 else f"{len(result.rig)} cameras"
    whose = "" if len(result.person_ids) == 1 else "of people, while they are followed, "
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
    if stride > 1:
        sentences.append(f"The scene below shows every {stride}th frame of this long recording.")
    return "".join(f"<p>{escape(sentence)}</p>" for sentence in sentences)


def _length(millimetres: float) -> str:
    """A small length in a unit that shows it."""
    return f"{millimetres:.1f} mm" if millimetres >= 0.5 else f"{1000 * millimetres:.1f} µm"


def _accuracy_table(accuracy: Accuracy | PeopleScores | None) -> str:
    if accuracy is None:
        return ""
    rows = _people_rows(accuracy) if isinstance(accuracy, PeopleScores) else _one_rows(accuracy)
    body = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<h2>Against the truth</h2><table>{body}</table>"


def _people_rows(scores: PeopleScores) -> list[tuple[str, str]]:
    clear, nees = scores.clear[0], scores.nees
    covered = f"{_percent(nees.covered_68)} / {_percent(nees.covered_95)}"
    return [
        ("People of the truth, of the result", f"{scores.n_true_people}, {scores.n_people}"),
        (f"MOTA, matched within {clear.gate_m:g} m", _percent(clear.mota)),
        ("IDF1", _percent(scores.identity.idf1)),
        ("Recall", _percent(clear.recall)),
        ("Identity switches, fragments, false people", f"{clear.switches}, {clear.fragments}, {clear.false_people}"),
        ("Median error", f"{_or_dash(scores.median_mm)} mm"),
        ("Mean error (MPJPE)", f"{_or_dash(scores.mpjpe_mm)} mm"),
        ("Inside their 68 / 95 % region", covered),
    ]


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if np.isfinite(share) else "–"


def _one_rows(accuracy: Accuracy) -> list[tuple[str, str]]:
    rows = [
        ("Compared points", f"{accuracy.n_points}"),
        ("Median error", f"{accuracy.median_mm:.1f} mm"),
        ("Mean error (MPJPE)", f"{accuracy.mpjpe_mm:.1f} mm"),
        ("90 / 95 / 99 %", f"{accuracy.p90_mm:.1f} / {accuracy.p95_mm:.1f} / {accuracy.p99_mm:.1f} mm"),
        ("Beyond 5 cm", f"{100 * accuracy.share_beyond_50_mm:.2f} %"),
        ("Missing", f"{100 * accuracy.missing_share:.2f} %"),
    ]
    if accuracy.covered_68 is not None and accuracy.covered_95 is not None:
        covered = f"{100 * accuracy.covered_68:.0f} / {100 * accuracy.covered_95:.0f} %"
        rows.append(("Inside their 68 / 95 % region", covered))
    return rows


def _camera_table(result: Reconstruction, summary: Summary) -> str:
    head = "".join(f"<th>{escape(h)}</th>" for h in ("Camera", "Lens", "Used", "Median px", "90 % px"))
    rows = []
    for v, camera in enumerate(result.rig.cameras):
        error = summary.error_px_by_view[v]
        used = f"{100 * summary.used[v]:.1f} %"
        cells = (camera.name, str(camera.lens), used, _or_dash(error.median), _or_dash(error.p90))
        rows.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
    return f"<table><tr>{head}</tr>{''.join(rows)}</table>"


def _or_dash(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "–"


def _notes(result: Reconstruction) -> str:
    notes = result.provenance.notes
    inputs = [f"{name} (sha-256 {digest[:12]})" for name, digest in result.provenance.inputs.items()]
    items = [*notes, *(["Read: " + ", ".join(inputs)] if inputs else [])]
    return "<ul>" + "".join(f"<li>{escape(item)}</li>" for item in items) + "</ul>" if items else "<p>Nothing.</p>"


def _options(options: Options) -> str:
    def rows(values: dict[str, Any], prefix: str) -> str:
        out = ""
        for name, value in values.items():
            if isinstance(value, dict):
                out += rows(value, f"{prefix}{name}.")
            elif value not in (None, ()):
                out += f"<tr><th>{escape(prefix + name)}</th><td>{escape(str(value))}</td></tr>"
        return out

    return f"<table>{rows(dataclasses.asdict(options), '')}</table>"
