"""What every reader of pickles asks first, and how those without arrays are read."""

import io
import pickle
import pickletools
from typing import Any

_MOST_REMEMBERED = 100_000


def must_be_small(content: bytes) -> bytes:
    """Refuse a pickle that names places of a memory it does not need: making room for them takes gigabytes.

    Raises:
        ValueError: if it does, or is not whole.
    """
    for n, (opcode, argument, _) in enumerate(pickletools.genops(content)):
        if "PUT" in opcode.name and int(argument or 0) > max(_MOST_REMEMBERED, n):
            raise ValueError(f"it asks for room for {argument} values")
    return content


class _Plain(pickle.Unpickler):
    """Builds texts, numbers, tuples, lists and dicts, and refuses everything else."""

    def find_class(self, module: str, name: str) -> Any:
        raise pickle.UnpicklingError(f"it asks for {module}.{name}, which nothing but numbers and texts needs")


def load_plain(content: bytes) -> Any:
    """What a pickle of texts, numbers, tuples, lists and dicts holds.

    Raises:
        Exception: whatever broken bytes lead to; an UnpicklingError if it asks for anything else.
    """
    return _Plain(io.BytesIO(must_be_small(content))).load()
