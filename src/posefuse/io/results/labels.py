"""Conversion between codes and the labels in files."""

from enum import IntEnum
from pathlib import Path

import numpy as np

from posefuse.errors import FileError, choices
from posefuse.model.status import PointStatus, Source, ViewStatus


def _labels(codes: type[IntEnum]) -> np.ndarray:
    """Return the label of each code, also of codes read as unsigned bytes, shape (256,); empty for unused codes."""
    out = np.full(256, "", dtype=object)
    for code in codes:
        out[code.value] = code.label  # type: ignore[attr-defined]
    return out


STATUSES, SOURCES, VIEW_STATUSES = _labels(PointStatus), _labels(Source), _labels(ViewStatus)


def codes_of(words: np.ndarray, labels: np.ndarray, path: Path) -> np.ndarray:
    """Return the codes of labels, int8; an empty string gives -1, or 0 if that is the code without a label.

    Raises:
        FileError: if a string is not a label.
    """
    known = {label: code for code, label in enumerate(labels) if label}
    known[""] = 0 if not labels[0] else -1
    distinct, inverse = np.unique(words.astype(str), return_inverse=True)
    for word in distinct:
        if word not in known:
            raise FileError(
                f"{path}: unknown label {word!r}; expected one of {choices([word for word in known if word], 20)}."
            )
    codes = np.array([known[word] for word in distinct.tolist()], dtype=np.int8)
    return codes[inverse].reshape(words.shape)
