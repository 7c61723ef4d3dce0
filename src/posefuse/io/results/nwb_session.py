"""Session and subject of an NWB file, from the options of a result.

NWB requires the start time of the session; an unknown one is written as 1970. The archive DANDI also requires the
subject's identifier, species, sex, and age or date of birth. Nothing is written about a subject of whom nothing is
known.
"""

from datetime import UTC, datetime
from typing import Any

from posefuse.model.options.options import Options
from posefuse.model.options.subject import as_time
from posefuse.model.reconstruction import Reconstruction

UNKNOWN_START = datetime(1970, 1, 1, tzinfo=UTC)


def start_time(options: Options) -> datetime:
    """Return the start time of the session; 1970 if it is unknown."""
    text = options.session_start
    return UNKNOWN_START if text is None else as_time(text, "session_start", "2024-05-03T14:30:00+02:00")


def subject_fields(options: Options) -> dict[str, Any]:
    """Return the fields of pynwb's ``Subject``; empty if nothing is known of the subject."""
    subject = options.subject
    born = subject.date_of_birth
    fields = {
        "subject_id": subject.id,
        "species": subject.species,
        "sex": subject.sex,
        "age": subject.age,
        "date_of_birth": None if born is None else as_time(born, "subject.date_of_birth", "1998-04-12"),
    }
    return {name: value for name, value in fields.items() if value is not None}


def remarks(result: Reconstruction) -> tuple[str, ...]:
    """Return notes on what is unknown of the session and the subject, and how to state it."""
    known = subject_fields(result.options)
    missing = [
        name for name, field in (("id", "subject_id"), ("species", "species"), ("sex", "sex")) if field not in known
    ]
    if not {"age", "date_of_birth"} & set(known):
        missing.append("age")
    notes = []
    if result.options.session_start is None:
        notes.append("nwb: the start of the session is unknown and written as 1970; set `session_start`.")
    if missing:
        options = ", ".join(f"`subject.{name}`" for name in missing)
        notes.append(f"nwb: fields of the subject that the archive DANDI requires are missing; set {options}.")
    elif len(result.person_ids) > 1:
        notes.append(
            f"nwb: a file has one subject, {known['subject_id']}, but this result has {len(result.person_ids)}."
        )
    return tuple(notes)
