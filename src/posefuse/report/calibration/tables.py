"""Tables of the report of a calibration."""

from collections.abc import Iterable
from html import escape

import numpy as np

from posefuse.model.calibration_summary import CalibrationSummary
from posefuse.report.numbers import format_three_digits

_SPEED_M_S = 1.0


def camera_table(summary: CalibrationSummary) -> str:
    """Return one row per camera: errors, lens, and standard deviations."""
    counted = "Points" if summary.target == "points" else "Images"
    head = ("Camera", counted, "Error, px", "Held-out, px", "Lens", "Focal length, px", "Rotation ±, °",
            "Position ±, mm", "Time offset, ms")  # fmt: skip
    rows = [_camera_row(summary, v) for v in range(len(summary.cameras))]
    shown = [k for k in range(len(head)) if k == 0 or any(row[k] != "–" for row in rows)]
    cells = "".join(f"<th>{head[k]}</th>" for k in shown)
    body = "".join("<tr>" + _first_cell(v, row[0]) + _cells(row[k] for k in shown[1:]) for v, row in enumerate(rows))
    return f'<div class="wide"><table class="numbers"><tr>{cells}</tr>{body}</table></div>'


def _first_cell(v: int, name: str) -> str:
    return f'<th><span class="chip person-{v % 10}"></span> <a href="#camera-{v}">{escape(name)}</a></th>'


def _cells(values: Iterable[str]) -> str:
    return "".join(f"<td>{value}</td>" for value in values) + "</tr>"


def _camera_row(summary: CalibrationSummary, v: int) -> list[str]:
    camera, each = summary.rig.cameras[v], summary.cameras[v]
    focal = f"{camera.matrix[0, 0]:.1f}" if each.focal_sd_px else f"{camera.matrix[0, 0]:.0f}"
    lens = f"{camera.lens} (given)" if each.lens_given else str(camera.lens)
    is_reference = each.center_sd_m == 0.0
    if not np.isfinite(each.offset_sd_s):
        offset = "–"
    else:
        offset = "0" if is_reference else f"{1000 * each.offset_s:+.1f} ± {1000 * each.offset_sd_s:.1f}"
    return [
        camera.name,
        str(len(each.pixels) if summary.target == "points" else each.n_images),
        f"{each.error_px:.2f}",
        f"{each.held_out_px:.2f}" if np.isfinite(each.held_out_px) else "–",
        lens,
        focal + (f" ± {each.focal_sd_px:.1f}" if each.focal_sd_px else ""),
        "reference" if is_reference else format_three_digits(each.rotation_sd_deg),
        "reference" if is_reference else format_three_digits(1000 * each.center_sd_m),
        offset,
    ]


def shared_section(summary: CalibrationSummary) -> str:
    """Return the number of frames that cameras share; empty for points, which locate each camera on its own."""
    if summary.target == "points":
        return ""
    target = "the board" if summary.target == "board" else "the same people"
    return (
        f"<section><h2>Frames that cameras share</h2><p>Number of frames in which two cameras saw {target}. Every "
        f"camera needs ten or more with some other camera.</p>{shared_table(summary)}</section>"
    )


def shared_table(summary: CalibrationSummary) -> str:
    """Return the number of frames that each pair of cameras shares, the more the darker."""
    names, shared = summary.rig.names, summary.shared
    highest = max(int(shared.max()), 1)
    head = "".join(f"<th>{escape(name)}</th>" for name in names)
    body = ""
    for v, name in enumerate(names):
        cells = "".join(
            f'<td class="own">{n}</td>' if u == v else f'<td style="--heat:{70 * n / highest:.0f}%">{n}</td>'
            for u, n in enumerate(shared[v])
        )
        body += f"<tr><th>{escape(name)}</th>{cells}</tr>"
    return f'<div class="wide"><table class="heat shared"><tr><th></th>{head}</tr>{body}</table></div>'


def volume_table(summary: CalibrationSummary) -> str:
    """Return what the covariance of the cameras means for triangulated points."""
    volume = summary.volume
    to_what = "in the world" if summary.target == "points" else f"relative to camera {summary.rig.names[0]}"
    rows = [
        ("A point, relative to the other points of the volume", _mm(volume.relative_sd_m)),
        ("… at the best and the worst place", _range(volume.sd_m)),
        (f"A point in the middle of the volume, {to_what}", _mm(volume.middle_sd_m)),
        ("A length of 1 m", _mm(volume.length_sd)),
    ]
    if summary.scale_sd:
        rows.append(("The scale of everything", f"{100 * summary.scale_sd:.2g} %"))
    offsets = [each.offset_sd_s for each in summary.cameras if np.isfinite(each.offset_sd_s)]
    if any(offsets):
        text = f"A point that moves at {_SPEED_M_S:g} m/s, from the time offset of the least certain camera"
        rows.append((text, _mm(_SPEED_M_S * max(offsets))))
    body = "".join(f"<tr><th>{escape(name)}</th><td>{value}</td></tr>" for name, value in rows)
    return f'<table class="numbers"><tr><th>Standard deviation of</th><th></th></tr>{body}</table>'


def _range(sd_m: np.ndarray) -> str:
    return f"{_mm(float(sd_m.min()))} to {_mm(float(sd_m.max()))}" if len(sd_m) else "–"


def _mm(value_m: float) -> str:
    return f"{format_three_digits(1000 * value_m)} mm" if np.isfinite(value_m) else "–"


def length_table(summary: CalibrationSummary) -> str:
    """Return comparisons with known lengths; empty if there are none."""
    if not summary.lengths:
        return ""
    body = "".join(
        f"<tr><th>{escape(each.name)}</th><td>{each.n}</td><td>{100 * each.error:+.2f} %</td>"
        f"<td>{100 * each.spread:.2f} %</td></tr>"
        for each in summary.lengths
    )
    return (
        "<section><h2>Known lengths</h2><p>Points are triangulated one by one, without the known shape.</p>"
        '<div class="wide"><table class="numbers"><tr><th></th><th>Number</th><th>Median error</th><th>Spread</th></tr>'
        f"{body}</table></div></section>"
    )
