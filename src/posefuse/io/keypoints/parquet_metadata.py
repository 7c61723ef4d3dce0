"""What posefuse's parquet files say of themselves: skeleton, views, rate, notes; JSON in the metadata of the schema."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from posefuse.errors import FileError
from posefuse.io.netcdf import skeleton_from_text, skeleton_text
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton

_KEY = b"posefuse"
_VERSION = 1


@dataclass(frozen=True)
class About:
    """Of the recording that a table is of, or is a camera of.

    Attributes:
        skeleton: of the keypoints.
        views: their names, in order.
        rate_hz: or None.
        notes: what a reader found worth saying.
    """

    skeleton: Skeleton
    views: tuple[str, ...]
    rate_hz: float | None
    notes: tuple[str, ...]


def metadata_of(detections: Detections) -> dict[bytes, bytes]:
    """Metadata that say what detections are of."""
    about = {
        "version": _VERSION,
        "skeleton": skeleton_text(detections.skeleton),
        "views": detections.view_names,
        "rate_hz": detections.rate_hz,
        "notes": detections.notes,
    }
    return {_KEY: json.dumps(about).encode()}


def about_of(path: Path, metadata: Mapping[bytes, bytes] | None) -> About | None:
    """What metadata say; None of a table that another program wrote.

    Raises:
        FileError: if another version of posefuse wrote them.
    """
    if metadata is None or _KEY not in metadata:
        return None
    said = json.loads(metadata[_KEY])
    if said.get("version") != _VERSION:
        raise FileError(f"{path} was written by another version of posefuse (layout {said.get('version')}).")
    rate = said["rate_hz"]
    views, notes = tuple(map(str, said["views"])), tuple(map(str, said["notes"]))
    return About(skeleton_from_text(said["skeleton"]), views, None if rate is None else float(rate), notes)


def column_names(path: Path) -> list[str]:
    """The columns of a file; none of one that cannot be read."""
    import pyarrow.parquet as pq

    try:
        return list(pq.ParquetFile(path).schema_arrow.names)
    except Exception:  # a broken file raises whatever its bytes lead to
        return []
