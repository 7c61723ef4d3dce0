"""Ways to decide on sides by name."""

import warnings
from importlib import import_module

from posefuse.errors import PosefuseWarning
from posefuse.model.side_options import SideOptions
from posefuse.triangulation.sides.results import PairsInTime, Sides


def decide_sides(given: PairsInTime, method: str, options: SideOptions) -> Sides:
    """Decide which of each pair's points is the left one, by one of :data:`SIDE_METHODS`.

    Its notes are warnings too, once each.

    Raises:
        OptionsError: where the method cannot work on what is given.
    """
    sides: Sides = import_module(f"posefuse.triangulation.sides.{method}").decide(given, options)
    for note in sides.notes:
        warnings.warn(note, PosefuseWarning, stacklevel=2)
    return sides
