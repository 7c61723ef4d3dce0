"""Options that hold a number for each of some names, as a command line can give them."""

from collections.abc import Iterable

from posefuse.errors import OptionsError


def named_numbers(entries: Iterable[str], option: str, form: str, example: str) -> dict[str, float]:
    """By name, the numbers of entries such as ``cam_2=60``; a name may hold ``=`` itself.

    Args:
        entries: name and number.
        option: what it is called, for messages.
        form: what an entry is, for messages.
        example: of one.

    Raises:
        OptionsError: if an entry is not of that form.
    """
    found = {}
    for entry in entries:
        name, _, number = entry.rpartition("=")
        try:
            found[name.strip()] = float(number)
        except ValueError:
            raise OptionsError(f"{option} holds {form}, such as {example}; got {entry!r}.") from None
    return found
