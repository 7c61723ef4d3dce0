"""``posefuse methods``."""

from posefuse.cli.console import table


def methods() -> None:
    """List the triangulation methods; --triangulation.method chooses one."""
    from posefuse.model.options import METHODS, TriangulationOptions

    default = TriangulationOptions().method
    rows = [[f"{name}{' (default)' if name == default else ''}", sentence] for name, sentence in METHODS.items()]
    table(None, ["method", "what it does"], rows, words=True)
