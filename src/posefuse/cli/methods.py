"""``posefuse methods``."""

from posefuse.cli.console import say, table


def methods() -> None:
    """List the methods for triangulation, for left/right pairs and for left/right assignment."""
    from posefuse.model.options.left_right import SIDE_METHODS
    from posefuse.model.options.options import Options
    from posefuse.model.options.pairs import PAIR_METHODS
    from posefuse.model.options.triangulation import METHODS

    options = Options()
    lists = (
        ("--triangulation.method", METHODS, options.triangulation.method),
        ("--pairs", PAIR_METHODS, "enumerate"),
        ("--sides", SIDE_METHODS, options.sides),
    )
    for number, (flag, methods_of_flag, default) in enumerate(lists):
        if number:
            say("")
        rows = [
            [f"{name}{' (default)' if name == default else ''}", sentence] for name, sentence in methods_of_flag.items()
        ]
        table(None, [flag, "description"], rows, words=True)
