"""Conversion of numbers on the command line."""

from cyclopts import _convert


def whole_number(text: str) -> int:
    """Return an integer, which ``30.0`` also is.

    Raises:
        ValueError: if the text is none.
    """
    if "." not in text:
        return int(text)
    if not (number := float(text)).is_integer():
        raise ValueError(f"{text} is not an integer.")
    return int(number)


def refuse_fractions() -> None:
    """Let the parser refuse 1.5 where an integer is expected; by default it rounds, without a message.

    It has no public setting for that. In a version without this table, it rounds.
    """
    getattr(_convert, "_converters", {})[int] = whole_number
