"""Options of the subject's body."""

from dataclasses import dataclass
from typing import Literal

from posefuse.model.options.bounds import check_fields, option

MassTable = Literal["none", "winter", "de_leva_female", "de_leva_male"]


@dataclass(frozen=True)
class SubjectOptions:
    """Properties of the recorded subject that derived quantities need.

    Attributes:
        mass_table: Table of segment masses for the center of mass in com.csv; "none" writes no center of mass.
        mass_kg: Body mass of the subject, used in com.csv and in the scaling setup written for OpenSim.
    """

    mass_table: MassTable = "none"
    mass_kg: float | None = option(None, above=0.0, example="70.0")

    def __post_init__(self) -> None:
        check_fields(self, "subject")
