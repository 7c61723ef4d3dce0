"""Ways to decide on sides by name."""

import warnings
from importlib import import_module

from posefuse.errors import PosefuseWarning
from posefuse.model.side_options import SideOptions
from posefuse.triangulation.sides.results import PairsInTime, Sides


def decide_sides(given: PairsInTime, options: SideOptions | None = None) -> Sides:
    """Decide which of each pair's points is the left one, by the method the options name.

    Its notes are warnings too, once each.

    Raises:
        OptionsError: where the method cannot work on what is given.
    """
    options = options or SideOptions()
    sides: Sides = import_module(f"posefuse.triangulation.sides.{options.method}").decide(given, options)
    for note in sides.notes:
        warnings.warn(note, PosefuseWarning, stacklevel=2)
    return sides
