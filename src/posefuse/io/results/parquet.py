"""Parquet: the rows and columns of the tidy CSV with all fields of a layer, for efficient reading of large tables.

Additional columns: ``covariance_xx_m2`` to ``covariance_zz_m2``; ``views``, the names of the cameras used for the
point; ``view_status`` and ``view_error_px``, lists over all cameras in the order of the metadata. The metadata of
the schema are ``posefuse`` (JSON: layer, unit, rate_hz, people, cameras, skeleton, versions, inputs, notes)
and ``options`` (TOML). Rows are written by ranges of frames.
"""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.errors import FileError
from posefuse.io.arrow import arrow_table, columns_of, import_pyarrow
from posefuse.io.columns import Words
from posefuse.io.files import must_exist, reading, replacing
from posefuse.io.netcdf import skeleton_text
from posefuse.io.options import options_to_toml
from posefuse.io.parquet_files import check_parquet
from posefuse.io.parquet_footer import metadata_keys
from posefuse.io.results import csv, tidy
from posefuse.io.results.format import ResultFacts, ResultFormat
from posefuse.io.results.labels import VIEW_STATUSES, codes_of
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import COVARIANCE_ENTRIES, Reconstruction
from posefuse.model.status import is_used
from posefuse.model.stored_points import StoredPoints
from posefuse.progress import Progress, Silent, report_ranges

_VERSION = 1


def write(result: Reconstruction, path: Path, layer: LayerName, progress: Progress | None = None) -> None:
    """Write one layer of all people."""
    parquet = import_pyarrow().parquet
    schema = _table(result.frames(0, 0), layer).schema.with_metadata(_metadata(result, layer))
    parts = report_ranges(result.chunks(), result.n_frames, f"writing {path.name}", progress or Silent())
    with replacing(path) as temporary, parquet.ParquetWriter(temporary, schema, compression="zstd") as file:
        for part in parts:
            file.write_table(_table(part, layer).replace_schema_metadata(schema.metadata))


def require(_: ResultFacts) -> None:
    """Refuse to write any result without pyarrow.

    Raises:
        FileError: if it is not installed.
    """
    import_pyarrow()


def _metadata(result: Reconstruction, layer: LayerName) -> dict[str, str]:
    cameras = [
        {
            "name": camera.name,
            "size_px": list(camera.size_px),
            "matrix": camera.matrix.tolist(),
            "camera_from_world": camera.camera_from_world.tolist(),
            "lens": str(camera.lens),
            "distortion": list(camera.distortion),
        }
        for camera in result.rig.cameras
    ]
    metadata = {
        "version": _VERSION,
        "layer": layer,
        "unit": result.unit,
        "rate_hz": result.rate_hz,
        "up_axis": result.rig.up_axis,
        "inferred_up": result.rig.inferred_up and asdict(result.rig.inferred_up),
        "people": list(result.person_ids),
        "keypoints": list(result.skeleton.keypoints),
        "cameras": cameras,
        "skeleton": json.loads(skeleton_text(result.skeleton)),
        "provenance": asdict(result.provenance),
    }
    options = {"options": result.options, "resolved_options": result.resolved}
    return {"posefuse": json.dumps(metadata)} | {name: options_to_toml(each) for name, each in options.items()}


def _table(part: Reconstruction, name: LayerName) -> Any:
    pa = import_pyarrow()
    table = arrow_table(csv.columns_of(part, name), coded_words=False)
    layer, views = part.layers[name], len(part.rig)
    covariance = np.asarray(layer.covariance_m2[:]).reshape(-1, 6)
    for i, entry in enumerate(COVARIANCE_ENTRIES):
        table = table.append_column(f"covariance_{entry}_{part.unit}2", pa.array(covariance[:, i], from_pandas=True))
    status = np.asarray(layer.view_status[:]).reshape(-1, views)
    errors = np.asarray(layer.view_error_px[:], dtype=np.float32).reshape(-1, views)
    used = is_used(status)
    ends = np.concatenate([[0], np.cumsum(used.sum(axis=-1))])
    names = np.broadcast_to(np.array(part.rig.names, dtype=object), used.shape)[used]
    lists = {
        "views": pa.ListArray.from_arrays(pa.array(ends, pa.int32()), pa.array(names, pa.string())),
        "view_status": _lists(pa.array(VIEW_STATUSES[status].ravel(), pa.string()), views, len(status)),
        "view_error_px": _lists(pa.array(errors.ravel(), from_pandas=True), views, len(errors)),
    }
    for key, column in lists.items():
        table = table.append_column(key, column)
    return table


def _lists(values: Any, each: int, rows: int) -> Any:
    pa = import_pyarrow()
    return pa.ListArray.from_arrays(pa.array(np.arange(rows + 1) * each, pa.int32()), values)


def matches(path: Path) -> bool:
    """Return whether a file is in this format."""
    try:
        return "posefuse" in metadata_keys(path)
    except (OSError, ValueError):
        return False


def read(path: Path) -> StoredPoints:
    """Read a layer.

    Raises:
        FileError: if it is not a parquet file of points that posefuse wrote, is corrupt, or pyarrow is not installed.
    """
    must_exist(path, "parquet file")
    parquet = import_pyarrow().parquet
    with reading(path, "parquet file"):
        check_parquet(path)
        table = parquet.ParquetFile(path).read(use_threads=False)
        if b"posefuse" not in (table.schema.metadata or {}):
            raise FileError(
                f"{path} is a parquet file that posefuse did not write: its schema has no metadata named posefuse."
            )
        metadata = json.loads(table.schema.metadata[b"posefuse"])
        points = tidy.points_of(
            columns_of(path, table, words=tidy.WORDS, numbers=tidy.NUMBERS),
            path,
            metadata["people"],
            metadata["keypoints"],
            metadata["layer"],
            metadata["rate_hz"],
        )
        return _with_views(points, table, tuple(camera["name"] for camera in metadata["cameras"]), path)


def _with_views(points: StoredPoints, table: Any, names: tuple[str, ...], path: Path) -> StoredPoints:
    shape = (*points.points_m.shape[:3], len(names))

    def flat(column: str) -> Any:
        return table[column].combine_chunks().flatten()

    return replace(
        points,
        view_names=names,
        view_status=codes_of(Words.of(flat("view_status").to_pylist()).values(), VIEW_STATUSES, path).reshape(shape),
        view_error_px=np.array(flat("view_error_px").to_numpy(zero_copy_only=False)).reshape(shape),
    )


FORMAT = ResultFormat(
    name="parquet",
    files="*.parquet",
    conventions=(
        "the tidy CSV's columns, covariances and views; meters, world axes; cameras and options in the metadata"
    ),
    additional_name="points.parquet",
    holds_stills=True,
    endings=(".parquet",),
    matches=matches,
    read=read,
    write_layer=write,
    require=require,
)
