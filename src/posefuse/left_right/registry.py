"""Ways to decide on sides by name."""

import warnings
from importlib import import_module

from posefuse.errors import PosefuseWarning
from posefuse.left_right.results import PairsInTime, Sides
from posefuse.model.options.left_right import SideOptions

_MODULES = {"chains": "limb_chains", "plane": "plane", "votes": "votes"}


def decide_sides(given: PairsInTime, method: str, options: SideOptions) -> Sides:
    """Decide which of each pair's points is the left one, by one of :data:`SIDE_METHODS`.

    Its notes are warnings too, once each.

    Raises:
        OptionsError: where the method cannot work on what is given.
    """
    sides: Sides = import_module(f"posefuse.left_right.{_MODULES[method]}").decide(given, options)
    for note in sides.notes:
        warnings.warn(note, PosefuseWarning, stacklevel=2)
    return sides
