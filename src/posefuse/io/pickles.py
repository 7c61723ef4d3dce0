"""Safe reading of pickles.

``pickle.load`` executes code that a file names (``test_pickles_execute_nothing`` holds such a file) and allocates any
amount of memory for memo indices, so pickles are checked first and only harmless objects are built.
"""

import io
import pickle
import pickletools
from typing import Any

_MAX_MEMO_INDEX = 100_000


def check_memo(content: bytes) -> bytes:
    """Return a pickle unless its memo indices are far larger than needed: allocating them takes gigabytes.

    Raises:
        ValueError: If an index is too large or the pickle is broken.
    """
    for n, (opcode, argument, _) in enumerate(pickletools.genops(content)):
        if "PUT" in opcode.name and int(argument or 0) > max(_MAX_MEMO_INDEX, n):
            raise ValueError(f"it allocates memory for {argument} values")
    return content


class _PlainUnpickler(pickle.Unpickler):
    """Build strings, numbers, tuples, lists and dicts only."""

    def find_class(self, module: str, name: str) -> Any:
        raise pickle.UnpicklingError(f"it refers to {module}.{name}; only numbers and strings are read")


def load_plain(content: bytes) -> Any:
    """Return the content of a pickle of strings, numbers, tuples, lists and dicts.

    Raises:
        UnpicklingError: If it contains any other object.
        Exception: Any other exception that broken bytes cause.
    """
    return _PlainUnpickler(io.BytesIO(check_memo(content))).load()
