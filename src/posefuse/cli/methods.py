"""``posefuse methods``."""

from posefuse.cli.console import say, table


def methods() -> None:
    """List what can be chosen: triangulation methods, and how left and right are told apart."""
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
    for number, (flag, choices, default) in enumerate(lists):
        if number:
            say("")
        rows = [[f"{name}{' (default)' if name == default else ''}", sentence] for name, sentence in choices.items()]
        table(None, [flag, "what it does"], rows, words=True)
