"""Conversion of numbers on the command line."""

from cyclopts import _convert


def whole_number(text: str) -> int:
    """Return the integer that a text states; ``30.0`` states one, too.

    Raises:
        ValueError: if the text does not state an integer.
    """
    if "." not in text:
        return int(text)
    if not (number := float(text)).is_integer():
        raise ValueError(f"{text} is not an integer.")
    return int(number)


def refuse_fractions() -> None:
    """Make the parser refuse 1.5 where an integer is expected; by default, it rounds without a message.

    The parser has no public setting for this. A version without this table of converters still rounds.
    """
    getattr(_convert, "_converters", {})[int] = whole_number
