"""Options of the subject."""

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal

from posefuse.errors import OptionsError
from posefuse.model.options.bounds import check_fields, option

Sex = Literal["F", "M", "U", "O"]
MassTable = Literal["auto", "none", "winter", "de_leva_mean", "de_leva_female", "de_leva_male"]


_DURATION = r"P(?!$|/)(?:\d+Y)?(?:\d+M)?(?:\d+W)?(?:\d+D)?(?:T(?=\d)(?:\d+H)?(?:\d+M)?(?:\d+S)?)?"
_FORMS = {
    "id": (r"[^/\\\s](?:[^/\\\n]*[^/\\\s])?", "a name without slashes"),
    "species": (
        r"[A-Z][a-z]+ [a-z]+(?: [a-z]+)?|http://purl\.obolibrary\.org/obo/NCBITaxon_\d+",
        "a Latin name such as Mus musculus, or an address such as http://purl.obolibrary.org/obo/NCBITaxon_10090",
    ),
    "age": (rf"{_DURATION}(?:/(?:{_DURATION})?)?", "an ISO 8601 duration such as P25Y, P12W or P90D"),
}
"""Pattern of each text, and its form in words."""


@dataclass(frozen=True)
class SubjectOptions:
    """Properties of the recorded subject that derived quantities need.

    Attributes:
        mass_table: Table of segment masses for the center of mass in com.csv; "auto" uses de Leva's for the subject's
            sex, or the mean of both, for people over time whose skeletons have all segments, and "none" writes none.
        static: Frames START:STOP of the recording in which people stand upright with straight legs, or the result of
            such a static trial; joint angles are zero in anatomical alignment as it shows it.
        mass_kg: Body mass of the subject, used in com.csv and segment_masses.csv, and in the scaling setup written for
            OpenSim.
        id: Identifier of the subject in NWB files, without slashes.
        species: Species of the subject in NWB files, as its Latin name or the address of its NCBI taxon.
        sex: Sex of the subject, for segment masses and NWB files: F, M, U (unknown) or O (other).
        age: Age of the subject in NWB files as an ISO 8601 duration, such as P25Y or P90D, or a range P20Y/P30Y.
        date_of_birth: Date of birth of the subject in NWB files, such as 1998-04-12.
    """

    mass_table: MassTable = "auto"
    static: str | None = option(None, example='"0:60"')
    mass_kg: float | None = option(None, above=0.0, example="70.0")
    id: str | None = option(None, example='"s01"')
    species: str | None = option(None, example='"Homo sapiens"')
    sex: Sex | None = None
    age: str | None = option(None, example='"P25Y"')
    date_of_birth: str | None = option(None, example='"1998-04-12"')

    def __post_init__(self) -> None:
        check_fields(self, "subject")
        for name, (pattern, form) in _FORMS.items():
            value = getattr(self, name)
            if value is not None and not re.fullmatch(pattern, value):
                raise OptionsError(f"subject.{name} must be {form}, got {value!r}.")
        if self.date_of_birth is not None:
            as_time(self.date_of_birth, "subject.date_of_birth", "1998-04-12")


def as_time(text: str, name: str, example: str) -> datetime:
    """Return an ISO 8601 date or time; a date without a time zone is midnight UTC.

    Raises:
        OptionsError: if it is not one, or a time of day lacks its time zone.
    """
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        raise OptionsError(f"{name} must be an ISO 8601 date or time, such as {example}, got {text!r}.") from None
    if time.tzinfo is None and len(text) > len("1998-04-12"):
        raise OptionsError(f"{name} needs a time zone, such as {text}+00:00; got {text!r}.")
    return time if time.tzinfo is not None else time.replace(tzinfo=UTC)
