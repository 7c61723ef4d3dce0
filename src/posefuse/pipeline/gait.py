"""Analyze contact, gait and repetitions of all people of a result. The recipe of every caller."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from posefuse.arguments import checked
from posefuse.biomechanics.foot_paths import SIDES, foot_paths, has_feet
from posefuse.biomechanics.gait import Gait, analyze_person
from posefuse.biomechanics.gait_parameters import mean_of
from posefuse.biomechanics.mean_intervals import half_width_of_one
from posefuse.model.joint_angles import OPENSIM
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.track_events import Event

GAIT_FILE, CYCLES_FILE = "gait.csv", "cycles.csv"
_MIN_FRAMES = 8


@checked
@dataclass(frozen=True, eq=False)
class GaitResult:
    """Contact, gait and repetitions of the people of a result.

    Attributes:
        layer: layer of the points.
        people: analysis of each person by name.
        frame_numbers: shape (frame,).
        time_s: shape (frame,).
    """

    layer: LayerName
    people: Mapping[str, Gait]
    frame_numbers: np.ndarray
    time_s: np.ndarray

    @property
    def contact(self) -> np.ndarray:
        """Probability of contact, shape (frame, person, foot, part): left and right foot, heel and toes."""
        return np.stack([gait.contact.probability for gait in self.people.values()], axis=1)

    @property
    def sliding(self) -> np.ndarray:
        """Probability that a foot touches and slides, shape (frame, person, foot)."""
        return np.stack([gait.contact.sliding for gait in self.people.values()], axis=1)

    def events(self) -> tuple[Event, ...]:
        """Return heel strikes, toe-offs and repetitions at their exact times, with the nearest frame."""
        found = []
        for person, gait in self.people.items():
            for event in gait.events:
                why = f"{SIDES[event.side]} foot, sd {event.sd_s:.3f} s, confidence {event.confidence:.2f}"
                found.append((event.time_s, person, event.kind, why))
            for each in gait.repetitions:
                why = f"{each.size_m:.3f} m in {each.duration_s:.2f} s"
                found.append((each.start_s, person, each.kind, why))
        return tuple(
            Event(self._nearest_frame(time), time, person, kind, why)
            for time, person, kind, why in sorted(found, key=lambda row: row[:3])
        )

    def tables(self) -> dict[str, Mapping[str, np.ndarray]]:
        """Return the columns of the tables of parameters and of cycles by file name; without rows, none."""
        tables: dict[str, Mapping[str, np.ndarray]] = {}
        if any(gait.parameters for gait in self.people.values()):
            tables[GAIT_FILE] = self._parameter_columns()
        if any(gait.cycles for gait in self.people.values()):
            tables[CYCLES_FILE] = self._cycle_columns()
        return tables

    def summary(self) -> tuple[str, ...]:
        """Return a line for each person with gait or repetitions."""
        lines = (_line(person, gait) for person, gait in self.people.items())
        return tuple(line for line in lines if line)

    def _nearest_frame(self, time_s: float) -> int:
        return int(self.frame_numbers[int(np.abs(self.time_s - time_s).argmin())])

    def _parameter_columns(self) -> dict[str, np.ndarray]:
        rows = [(person, each) for person, gait in self.people.items() for each in gait.parameters]
        columns = {"person": np.array([person for person, _ in rows], dtype=object)}
        columns |= {
            title: np.array([getattr(each, name) for _, each in rows], dtype=object)
            for title, name in (("parameter", "name"), ("side", "side"))
        }
        columns |= {name: np.array([getattr(each, name) for _, each in rows]) for name in ("value", "sd", "n")}
        columns |= {name: np.array([getattr(each, name) for _, each in rows]) for name in ("low95", "high95")}
        return {**columns, "layer": np.array([self.layer] * len(rows), dtype=object)}

    def _cycle_columns(self) -> dict[str, np.ndarray]:
        rows = [(person, each) for person, gait in self.people.items() for each in gait.cycles]
        size = len(rows[0][1].mean)
        columns = {
            "person": np.repeat(np.array([person for person, _ in rows], dtype=object), size),
            "side": np.repeat(np.array([each.side for _, each in rows], dtype=object), size),
            "signal": np.repeat(np.array([each.signal for _, each in rows], dtype=object), size),
            "percent": np.tile(np.arange(size), len(rows)),
        }
        columns |= {name: np.concatenate([getattr(each, name) for _, each in rows]) for name in ("mean", "sd", "n")}
        half = half_width_of_one(columns["sd"], columns["n"])
        columns |= {"low95": columns["mean"] - half, "high95": columns["mean"] + half}
        return {**columns, "layer": np.array([self.layer] * len(rows) * size, dtype=object)}


@checked
def analyze_gait(result: Reconstruction) -> GaitResult | None:
    """Estimate foot contact, gait events and parameters, and repetitions of every person.

    Args:
        result: its best layer, or the layer set in its options, is used.

    Returns:
        The analysis, or None if the result does not allow one: without heels and toes, meters, an up axis, frame times
        or identities, or with fewer than eight frames.
    """
    times = np.asarray(result.time_s)
    usable = (
        result.unit == "m" and result.rig.up is not None and result.has_identities and result.person_ids
        and has_feet(result.skeleton) and len(times) >= _MIN_FRAMES
    )  # fmt: skip
    if not usable or not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        return None
    layer, _ = result.best_layer(result.options.layer)
    assert result.rig.up is not None
    paths = foot_paths(result.windows(), layer, result.rig.up)
    people = {
        person: analyze_person(each, _angles_deg(result, p))
        for p, (person, each) in enumerate(zip(result.person_ids, paths, strict=True))
    }
    return GaitResult(layer, people, np.asarray(result.frame_numbers), times)


def _angles_deg(result: Reconstruction, person: int) -> dict[str, np.ndarray]:
    """Return the OpenSim coordinates of a person by name without the side, shape (frame, side); empty without any."""
    angles = result.joint_angles
    if angles is None:
        return {}
    degrees = np.asarray(angles.degrees[:, person])
    return {name: degrees[:, list(sides)] for name, sides in angles.sides(OPENSIM).items() if min(sides) >= 0}


def _line(person: str, gait: Gait) -> str:
    """Return a summary of a person's gait and repetitions; empty without any."""
    parts = []
    steps = sum(event.kind == "heel_strike" for event in gait.events)
    if steps:
        parts.append(_counted(steps, "step", "steps"))
        parts += _of_strides(gait)
    for kind, one, several in (
        ("jump", "jump", "jumps"), ("squat", "squat", "squats"),
        ("sit_to_stand", "rise from a seat", "rises from a seat"),
    ):  # fmt: skip
        own = [each.size_m for each in gait.repetitions if each.kind == kind]
        if own:
            parts.append(f"{_counted(len(own), one, several)} ({float(np.mean(own)):.2f} m)")
    return f"{person}: {', '.join(parts)}" if parts else ""


def _of_strides(gait: Gait) -> list[str]:
    """Return cadence, speed and stride length with the number of strides that all three rest on."""
    cadence, speed, length = (
        mean_of(gait.parameters, name) for name in ("cadence_steps_min", "speed_m_s", "stride_length_m")
    )
    if cadence is None or speed is None or length is None:
        return []
    return [
        f"{cadence.value:.0f} steps/min",
        f"{speed.value:.2f} m/s",
        f"{length.value:.2f} m per stride (from {_counted(length.n, 'stride', 'strides')})",
    ]


def _counted(n: int, one: str, several: str) -> str:
    return f"{n} {one if n == 1 else several}"
