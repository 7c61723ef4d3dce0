"""Options that hold one number per name, written as ``name=number`` so that a command line can pass them."""

from collections.abc import Iterable

from posefuse.errors import OptionsError


def named_numbers(entries: Iterable[str], option: str, form: str, example: str) -> dict[str, float]:
    """Return the numbers of entries such as ``cam_2=60`` by name; a name may contain ``=`` itself.

    Args:
        entries: Names with their numbers.
        option: Name of the option, for messages.
        form: Form of an entry, for messages.
        example: Example of an entry, for messages.

    Raises:
        OptionsError: if an entry does not have the form.
    """
    numbers = {}
    for entry in entries:
        name, _, number = entry.rpartition("=")
        try:
            numbers[name.strip()] = float(number)
        except ValueError:
            raise OptionsError(f"{option} must contain {form} entries such as {example}, got {entry!r}.") from None
    return numbers


def named_texts(entries: Iterable[str], option: str, form: str, example: str) -> dict[str, str]:
    """Return the texts of entries such as ``cam_2=videos/a.mp4`` by name; a text may contain ``=`` itself.

    Args:
        entries: Names with their texts.
        option: Name of the option, for messages.
        form: Form of an entry, for messages.
        example: Example of an entry, for messages.

    Raises:
        OptionsError: if an entry does not have the form, or two have the same name.
    """
    texts: dict[str, str] = {}
    for entry in entries:
        name, _, text = (part.strip() for part in entry.partition("="))
        if not (name and text):
            raise OptionsError(f"{option} must contain {form} entries such as {example}, got {entry!r}.")
        if name in texts:
            raise OptionsError(f"{option} must name everything once, got {name!r} twice.")
        texts[name] = text
    return texts
