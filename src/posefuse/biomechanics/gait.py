"""Analyze the contacts, gait and repetitions of one person."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from posefuse.biomechanics.contact import Contact, ContactModel, estimate_contact
from posefuse.biomechanics.contact_times import Interval, foot_intervals
from posefuse.biomechanics.cycles import Cycle, gait_cycles
from posefuse.biomechanics.foot_paths import SIDES, FootPaths
from posefuse.biomechanics.gait_events import GaitEvent, gait_events
from posefuse.biomechanics.gait_parameters import GaitParameter, gait_parameters, summary
from posefuse.biomechanics.repetitions import Repetition, find_repetitions

_EDGE_S = 0.15


@dataclass(frozen=True, eq=False)
class Gait:
    """Contacts, gait and repetitions of one person.

    Attributes:
        contact: contact of the feet; its probabilities change at the times of the intervals.
        intervals: contact intervals by side (left, right) and part (heel, toes).
        events: heel strikes and toe-offs.
        repetitions: jumps, squats and sit-to-stands.
        parameters: parameters of gait and repetitions; empty without either.
        cycles: normalized gait cycles.
    """

    contact: Contact
    intervals: list[list[list[Interval]]]
    events: list[GaitEvent]
    repetitions: list[Repetition]
    parameters: list[GaitParameter]
    cycles: list[Cycle]


def analyze_person(paths: FootPaths, angles_deg: Mapping[str, np.ndarray] | None = None) -> Gait:
    """Analyze one person's contacts, gait and repetitions.

    Args:
        paths: paths of the person.
        angles_deg: joint angles by name, shape (frame, side), for the gait cycles.
    """
    contact, intervals = timed_contact(paths)
    events = gait_events(paths, intervals)
    repetitions = find_repetitions(paths, intervals, events)
    model = contact.model
    parameters = gait_parameters(paths, events, intervals, model.ground_m_s)
    parameters += _repetition_parameters(repetitions)
    cycles = gait_cycles(paths, events, model.levels, angles_deg or {}, model.ground_m_s)
    return Gait(contact, intervals, events, repetitions, parameters, cycles)


def timed_contact(paths: FootPaths, model: ContactModel | None = None) -> tuple[Contact, list[list[list[Interval]]]]:
    """Return contact that changes between frames, and its intervals by side and part.

    Args:
        paths: paths of the person.
        model: ground, levels and spread; by default estimated from the paths.
    """
    contact = estimate_contact(paths, model)
    intervals = [
        foot_intervals(paths.time_s, paths.feet_m[:, s], contact.model.ground_m_s, contact.probability[:, s])
        for s in range(len(SIDES))
    ]
    return _with_times(contact, paths.time_s, intervals), intervals


def _with_times(contact: Contact, time_s: np.ndarray, intervals: list[list[list[Interval]]]) -> Contact:
    """Return the contact with probabilities that change at the times of the intervals."""
    probability = contact.probability.copy()
    for s, parts in enumerate(intervals):
        for p, spans in enumerate(parts):
            inside, near = np.zeros(len(time_s)), np.zeros(len(time_s), dtype=bool)
            for span in spans:
                begun = ndtr((time_s - span.start_s) / span.start_sd_s) if np.isfinite(span.start_s) else 1.0
                over = ndtr((time_s - span.end_s) / span.end_sd_s) if np.isfinite(span.end_s) else 0.0
                inside = np.maximum(inside, begun * (1.0 - over))
                near |= np.minimum(np.abs(time_s - span.start_s), np.abs(time_s - span.end_s)) < _EDGE_S
            known = np.isfinite(probability[:, s, p])
            probability[:, s, p] = np.where(near & known, inside, probability[:, s, p])
    return replace(contact, probability=probability)


def _repetition_parameters(repetitions: list[Repetition]) -> list[GaitParameter]:
    """Return counts, sizes and durations of repetitions."""
    names = {
        "jump": ("jump_height_m", "jump_flight_time_s"),
        "squat": ("squat_depth_m", "squat_time_s"),
        "sit_to_stand": ("sit_to_stand_rise_m", "sit_to_stand_time_s"),
    }
    found = []
    for kind, (size, duration) in names.items():
        own = [each for each in repetitions if each.kind == kind]
        if own:
            found.append(summary(size, "both", np.array([each.size_m for each in own])))
            found.append(summary(duration, "both", np.array([each.duration_s for each in own])))
    return found
