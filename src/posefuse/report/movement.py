"""Joint angles, gait cycles, foot contact and gait parameters in the report, with left and right overlaid."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from posefuse.arrays import ranges
from posefuse.biomechanics.cycles import Cycle
from posefuse.biomechanics.foot_paths import PARTS, SIDES
from posefuse.biomechanics.gait import Gait
from posefuse.biomechanics.gait_parameters import GaitParameter, mean_of
from posefuse.biomechanics.mean_intervals import MIN_VALUES
from posefuse.model.detections import CHUNK_FRAMES
from posefuse.model.joint_angles import JointAngles
from posefuse.model.reconstruction import Reconstruction
from posefuse.report.matplotlib_extra import BLUE, ORANGE
from posefuse.report.series import TimeSeries, blocks_of_intervals, mean_per_interval

SIDES_KEY = '<span class="left">Left</span>, <span class="right">right</span>'
SIDE_COLORS = {"left": BLUE, "right": ORANGE}
_CLINICAL = tuple(
    f"{name}_deg"
    for name in (
        "pelvis_tilt", "pelvis_list", "pelvis_rotation", "hip_flexion", "hip_adduction", "hip_rotation", "knee_angle",
        "ankle_angle", "lumbar_extension",
    )
)  # fmt: skip
_WITHOUT_ANGLES = ("knee_flexion_deg", "heel_height_m", "toe_height_m")
_UNITS = {"deg": "degrees", "m": "m", "s": "s", "percent": "%"}
_COMPOUND_UNITS = {"steps_min": "steps/min", "m_s": "m/s"}


def shown_signals(cycles: Iterable[Cycle]) -> tuple[str, ...]:
    """Return the signals of gait cycles that figures show: joint angles, or heights and the knee without any."""
    found = {cycle.signal for cycle in cycles}
    return tuple(name for name in _CLINICAL if name in found) or tuple(n for n in _WITHOUT_ANGLES if n in found)


def signal_title(name: str) -> str:
    """Return the title of a quantity whose name ends in its unit, such as ``hip_flexion_deg``."""
    for ending, unit in (_COMPOUND_UNITS | _UNITS).items():
        if name.endswith(f"_{ending}"):
            return f"{name.removesuffix(f'_{ending}').replace('_', ' ')}, {unit}"
    return name.replace("_", " ")


def movement_section(result: Reconstruction, gait: Mapping[str, Gait]) -> str:
    """Return gait parameters, and places for the charts that :func:`movement_data` has data for, as HTML."""
    parts = []
    if _has_contact(gait):
        parts.append(
            "<section><h2>Foot contact</h2><p>When heels and toes touch the ground: they are near it and move like it. "
            "Contact of feet that slide in every step is brief. "
            '<span class="screen">Select a bar to see its frame.</span></p><div id="contact" class="chart" role="img" '
            'aria-label="Foot contact over time"></div></section>'
        )
    if any(each.parameters for each in gait.values()):
        tables = "".join(_parameter_table(person, each, len(gait) > 1) for person, each in gait.items())
        parts.append(f"<section><h2>Gait and repetitions</h2>{tables}</section>")
    with_cycles = [each for each in gait.values() if each.cycles]
    if with_cycles:
        parts.append(
            "<section><h2>Gait cycles</h2><p>Mean from heel strike to heel strike, and one standard deviation over "
            f'cycles (<span id="cycle-numbers">{_cycle_numbers(with_cycles[0])}</span>). '
            f"Dotted lines mark toe-off. Pelvis rotation is relative to the direction of walking. {SIDES_KEY}. "
            '<span id="cycle-people"></span></p><div id="cycles" class="multiples"></div></section>'
        )
    if result.joint_angles is not None and _shown_angles(result.joint_angles):
        parts.append(
            f"<section><h2>Joint angles</h2><p>Degrees over time, with one standard deviation. {SIDES_KEY}. "
            '<span id="angle-people"></span></p><div id="angles" class="multiples"></div></section>'
        )
    return f'<div id="movement">{"".join(parts)}</div>' if parts else ""


def _parameter_table(person: str, gait: Gait, named: bool) -> str:
    """Return the table of a person's parameters: mean, standard deviation, 95 % interval of the mean, and number."""
    if not gait.parameters:
        return ""
    names = tuple(dict.fromkeys(each.name for each in gait.parameters))
    rows = []
    for name in names:
        cells = (_cell(mean_of(gait.parameters, name, side)) for side in (*SIDES, "both"))
        rows.append(f"<tr><th>{escape(signal_title(name))}</th>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>")
    head = "".join(f"<th>{each}</th>" for each in ("Parameter", "Left", "Right", "Both"))
    title = f"<h3>{escape(person)}</h3>" if named else ""
    return (
        f'{title}<div class="wide"><table class="parameters"><tr>{head}</tr>{"".join(rows)}</table></div>'
        "<p>Mean &plusmn; standard deviation over n steps, strides or repetitions (95 % interval of the mean, for "
        f"n &ge; {MIN_VALUES}); of asymmetries, &plusmn; standard error. "
        "Heel strikes and toe-offs count if contact and the path of the foot both show them, "
        "and stances if the foot is in contact during them.</p>"
    )


def _cell(parameter: GaitParameter | None) -> str:
    if parameter is None:
        return "&ndash;"
    digits = 1 if parameter.name.endswith(("_percent", "_min")) else 3 if parameter.name.endswith("_s") else 2
    text = f"{parameter.value:.{digits}f}"
    if np.isfinite(parameter.sd):
        text += f"&nbsp;&plusmn;&nbsp;{parameter.sd:.{digits}f}"
    if np.isfinite(parameter.low95):
        text += f" ({parameter.low95:.{digits}f}&nbsp;to&nbsp;{parameter.high95:.{digits}f})"
    return f"{text}, n&nbsp;=&nbsp;{parameter.n}"


def _has_contact(gait: Mapping[str, Gait]) -> bool:
    return any(part for each in gait.values() for side in each.intervals for part in side)


def movement_data(result: Reconstruction, gait: Mapping[str, Gait], series: TimeSeries) -> dict[str, Any] | None:
    """Return the angles, cycles and contacts as JSON data of the report page, or None without any."""
    data: dict[str, Any] = {}
    if result.joint_angles is not None:
        data["angles"] = _angle_data(result.joint_angles, series.interval_starts())
    if any(each.cycles for each in gait.values()):
        data["cycles"] = [_cycle_data(person, each) for person, each in gait.items() if each.cycles]
    if _has_contact(gait):
        data["contact"] = _contact_data(gait, np.asarray(result.time_s), len(gait) > 1)
    return data or None


def _shown_angles(angles: JointAngles) -> dict[str, tuple[int, int]]:
    """Return the angles of the first convention by name without the side: indices of the left and the right one."""
    spans = ranges(len(angles.status), CHUNK_FRAMES)
    known = np.any([np.isfinite(angles.degrees[slice(*span)]).any(axis=(0, 1)) for span in spans], axis=0)
    sides = angles.sides(angles.conventions[0]) if angles.conventions else {}
    return {name: pair for name, pair in sides.items() if any(i >= 0 and known[i] for i in pair)}


def _angle_data(angles: JointAngles, starts: np.ndarray) -> list[dict[str, Any]]:
    """Return the means of time intervals by angle; each of the curves has one row per person."""
    means = [_mean_angles(angles, *block) for block in blocks_of_intervals(starts, len(angles.status))]
    degrees, sd_deg = (np.concatenate(each) for each in zip(*means, strict=True))
    found = []
    for name, (left, right) in _shown_angles(angles).items():
        curves = {"both": left} if left == right else {"left": left, "right": right}
        found.append(
            {"title": name.replace("_", " ")}
            | {
                side: {"mean": _rows(degrees[:, :, i].T, 1), "sd": _rows(sd_deg[:, :, i].T, 1)}
                for side, i in curves.items()
                if i >= 0
            }
        )
    return found


def _mean_angles(angles: JointAngles, frames: slice, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the means of angles and of their standard deviations in intervals of some frames, in degrees."""
    # Circular means: an angle that passes 180 degrees continues at -180.
    radians = np.radians(np.asarray(angles.degrees[frames], dtype=np.float64))
    sine, cosine = (mean_per_interval(each, starts) for each in (np.sin(radians), np.cos(radians)))
    sd_deg = mean_per_interval(np.asarray(angles.sd_deg[frames], dtype=np.float64), starts)
    return np.degrees(np.arctan2(sine, cosine)), sd_deg


def _cycle_data(person: str, gait: Gait) -> dict[str, Any]:
    """Return the mean cycles of a person, and the end of the stance of each side in percent."""
    shown = shown_signals(gait.cycles)
    panels = []
    for signal in shown:
        own = {cycle.side: cycle for cycle in gait.cycles if cycle.signal == signal}
        digits = 3 if signal.endswith("_m") else 1
        curves = {
            side: {"mean": _numbers(each.mean, digits), "sd": _numbers(each.sd, digits)} for side, each in own.items()
        }
        panels.append({"title": signal_title(signal), **curves})
    stance = [mean_of(gait.parameters, "stance_percent", side) for side in SIDES]
    return {
        "person": person,
        "panels": panels,
        "numbers": _cycle_numbers(gait),
        "stance": [each and round(each.value, 1) for each in stance],
    }


def _cycle_numbers(gait: Gait) -> str:
    """Return the number of cycles of each side in the first chart, such as ``3 left, 2 right``."""
    first = shown_signals(gait.cycles)[:1]
    numbers = {each.side: int(each.n.max()) for each in gait.cycles if each.signal in first}
    return ", ".join(f"{numbers[side]} {side}" for side in SIDES if side in numbers)


def _contact_data(gait: Mapping[str, Gait], time_s: np.ndarray, named: bool) -> list[dict[str, Any]]:
    """Return one row per heel and toes with the intervals of contact in seconds, within the recording."""
    rows = []
    for person, each in gait.items():
        for s, side in enumerate(SIDES):
            for part, spans in zip(PARTS, each.intervals[s], strict=True):
                inside = [
                    np.clip([span.start_s, span.end_s], time_s[0], time_s[-1]).round(3).tolist() for span in spans
                ]
                label = f"{person}, {side} {part}" if named else f"{side} {part}"
                rows.append({"label": label, "side": side, "spans": inside})
    return rows


def _rows(values: np.ndarray, digits: int) -> list[list[float | None]]:
    return [_numbers(row, digits) for row in values]


def _numbers(values: Sequence[float] | np.ndarray, digits: int) -> list[float | None]:
    return [round(float(value), digits) if np.isfinite(value) else None for value in values]
