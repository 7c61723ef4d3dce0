"""Table of all triangulation methods; add a method here and in :mod:`posefuse.model.options.triangulation`."""

from posefuse.triangulation import consensus, irls, midpoint, percentile_filter, ransac, simple, weighted_subsets
from posefuse.triangulation.method import Method

METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        consensus.METHOD,
        simple.METHOD,
        weighted_subsets.METHOD,
        percentile_filter.METHOD,
        ransac.METHOD,
        irls.METHOD,
        midpoint.METHOD,
    )
}


def find_method(name: str) -> Method:
    """Return the method with a name that the options accept."""
    return METHODS[name]
