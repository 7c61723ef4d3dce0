"""Table of the methods that assign left and right; add one here and in :mod:`posefuse.model.options.left_right`."""

import warnings
from collections.abc import Callable

from posefuse.errors import PosefuseWarning
from posefuse.left_right import limb_chains, plane, votes
from posefuse.left_right.results import PairSequence, SideAssignment
from posefuse.model.options.left_right import SideOptions

METHODS: dict[str, Callable[[PairSequence, SideOptions], SideAssignment]] = {
    "chains": limb_chains.assign,
    "votes": votes.assign,
    "plane": plane.assign,
}


def assign_sides(sequence: PairSequence, method: str, options: SideOptions) -> SideAssignment:
    """Assign left and right to the two points of every pair, and issue the notes of the result as warnings.

    Args:
        sequence: solved pairs over time.
        method: one of :data:`posefuse.model.options.left_right.SIDE_METHODS`.
        options: of the method.

    Raises:
        OptionsError: if the method cannot handle the input.
    """
    assignment = METHODS[method](sequence, options)
    for note in assignment.notes:
        warnings.warn(note, PosefuseWarning, stacklevel=2)
    return assignment
