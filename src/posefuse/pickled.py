"""Pickle values without copying their large arrays."""

import pickle
from typing import Any

SEPARATE_BYTES = 1 << 16
"""Size from which an array is left out of a pickle."""


def pickled(value: Any) -> tuple[bytes, list[pickle.PickleBuffer]]:
    """Return the pickle of a value without its large arrays, and the memory of these arrays in order.

    Arrays that are not contiguous stay in the pickle. ``pickle.loads(head, buffers=arrays)`` returns the value, whose
    arrays share the memory that is passed.
    """
    arrays: list[pickle.PickleBuffer] = []

    def stays(buffer: pickle.PickleBuffer) -> bool:
        if buffer.raw().nbytes < SEPARATE_BYTES:
            return True
        arrays.append(buffer)
        return False

    return pickle.dumps(value, protocol=5, buffer_callback=stays), arrays
