"""What a user can say of the subject's body; the text of each attribute is the help."""

from dataclasses import dataclass
from typing import Literal, get_args

from posefuse.errors import OptionsError, suggestion

MassTable = Literal["none", "winter", "de_leva_female", "de_leva_male"]


@dataclass(frozen=True)
class SubjectOptions:
    """Of whom the recording is, for what is made of the points afterwards.

    Attributes:
        mass_table: By which table the centre of mass is found and written to com.csv: none, winter, de_leva_female or
            de_leva_male.
        mass_kg: The subject's mass: com.csv then says of how many kg the place is known.
    """

    mass_table: MassTable = "none"
    mass_kg: float | None = None

    def __post_init__(self) -> None:
        if self.mass_table not in get_args(MassTable):
            raise OptionsError(
                f"subject.mass_table: no {self.mass_table!r}. {suggestion(str(self.mass_table), get_args(MassTable))}"
            )
        if self.mass_kg is not None and not self.mass_kg > 0:
            raise OptionsError(f"subject.mass_kg must be positive, got {self.mass_kg}.")
