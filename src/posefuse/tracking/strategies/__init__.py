"""Strategies of the tracker and their components; see :class:`posefuse.tracking.strategy.Strategy`."""

from posefuse.model.options.tracker import StrategyName
from posefuse.tracking.strategies import default, specification
from posefuse.tracking.strategy import Strategy

_STRATEGIES: dict[StrategyName, Strategy] = {"posefuse": default.STRATEGY, "specification": specification.STRATEGY}


def find_strategy(name: StrategyName) -> Strategy:
    """Return the strategy of a name."""
    return _STRATEGIES[name]
