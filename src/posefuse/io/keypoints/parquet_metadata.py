"""Metadata in posefuse's parquet files: skeleton, views, rate and notes as JSON in the metadata of the schema."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from posefuse.errors import FileError
from posefuse.io.netcdf import skeleton_from_text, skeleton_text
from posefuse.io.parquet_footer import schema
from posefuse.model.detections import Detections
from posefuse.skeleton.skeletons import Skeleton

_KEY = b"posefuse"
_VERSION = 1


@dataclass(frozen=True)
class RecordingMetadata:
    """Metadata of the recording to which a table belongs.

    Attributes:
        skeleton: Skeleton of the keypoints.
        views: Names of the views, in order.
        rate_hz: Frame rate, or None.
        notes: Notes for the user.
    """

    skeleton: Skeleton
    views: tuple[str, ...]
    rate_hz: float | None
    notes: tuple[str, ...]


def metadata_of(detections: Detections) -> dict[bytes, bytes]:
    """Return the metadata to store with detections."""
    content = {
        "version": _VERSION,
        "skeleton": skeleton_text(detections.skeleton),
        "views": detections.view_names,
        "rate_hz": detections.rate_hz,
        "notes": detections.notes,
    }
    return {_KEY: json.dumps(content).encode()}


def read_metadata(path: Path, metadata: Mapping[bytes, bytes] | None) -> RecordingMetadata | None:
    """Return the metadata that posefuse stored in a table, or None if another program wrote the table.

    Raises:
        FileError: If another version of posefuse wrote the metadata.
    """
    if metadata is None or _KEY not in metadata:
        return None
    content = json.loads(metadata[_KEY])
    if content.get("version") != _VERSION:
        raise FileError(f"{path} was written by another version of posefuse (layout {content.get('version')}).")
    rate = content["rate_hz"]
    views, notes = tuple(map(str, content["views"])), tuple(map(str, content["notes"]))
    skeleton = skeleton_from_text(content["skeleton"])
    return RecordingMetadata(skeleton, views, None if rate is None else float(rate), notes)


def column_names(path: Path) -> list[str]:
    """Return the column names of a file, or none if it cannot be read."""
    try:
        return [name for name, _ in schema(path)]
    except (OSError, ValueError):
        return []
