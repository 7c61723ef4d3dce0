"""What every reader of pickles asks first."""

import pickletools

_MOST_REMEMBERED = 100_000


def must_be_small(content: bytes) -> bytes:
    """Refuse a pickle that names places of a memory it does not need: making room for them takes gigabytes.

    Raises:
        ValueError: if it does, or is not whole.
    """
    for opcode, argument, _ in pickletools.genops(content):
        if "PUT" in opcode.name and int(argument or 0) > _MOST_REMEMBERED:
            raise ValueError(f"it asks for room for {argument} values")
    return content
