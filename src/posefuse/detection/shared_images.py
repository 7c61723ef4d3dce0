"""Memory that this process and a worker map, for the images of one call."""

import mmap
import os
import sys
import tempfile
import uuid
from collections.abc import Sequence

import numpy as np


class SharedImages:
    """Memory for images that disappears with the last process that uses it, even if that is killed.

    Attributes:
        descriptor: file descriptor that the worker inherits; -1 on Windows, where :attr:`tag` names the memory.
        tag: name of the memory.
        n_bytes: its size.
    """

    def __init__(self) -> None:
        self.tag = ""
        self.n_bytes = 0
        self._map: mmap.mmap | None = None
        self.descriptor = _unnamed_file()

    def grow(self, n_bytes: int) -> None:
        """Make the memory at least this large; the worker must then map it again."""
        self._map = None
        if self.descriptor >= 0:
            os.ftruncate(self.descriptor, n_bytes)
            self._map = mmap.mmap(self.descriptor, n_bytes)
        else:
            self.tag = f"posefuse-{uuid.uuid4().hex}"
            self._map = mmap.mmap(-1, n_bytes, self.tag)  # type: ignore[arg-type]
        self.n_bytes = n_bytes

    def write(self, images: Sequence[np.ndarray] | np.ndarray) -> tuple[int, ...]:
        """Copy images of one shape into the memory, which must be large enough; return the shape of all."""
        shape = (len(images), *images[0].shape)
        array = np.frombuffer(self._map or b"", dtype=np.uint8, count=int(np.prod(shape))).reshape(shape)
        for i, image in enumerate(images):
            array[i] = image
        return shape

    def close(self) -> None:
        """Release the memory."""
        self._map = None
        self.n_bytes = 0
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1


def _unnamed_file() -> int:
    """Return the descriptor of a file without a name, in memory where the system can; -1 on Windows."""
    if sys.platform == "win32":
        return -1
    if hasattr(os, "memfd_create"):
        return os.memfd_create("posefuse-images")
    descriptor, path = tempfile.mkstemp(prefix="posefuse-")
    os.unlink(path)
    return descriptor
