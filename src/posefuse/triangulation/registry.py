"""Table of all triangulation methods, in the order of :data:`posefuse.model.options.triangulation.METHODS`.

The method of each name is the ``METHOD`` of the module with that name in this package.
"""

from importlib import import_module

from posefuse.model.options import triangulation
from posefuse.triangulation.method import Method

METHODS: dict[str, Method] = {
    name: import_module(f"posefuse.triangulation.{name}").METHOD for name in triangulation.METHODS
}


def find_method(name: str) -> Method:
    """Return the method with a name that the options accept."""
    return METHODS[name]
