"""Anipose's 3D CSV: one file per person, one row per frame, six columns per keypoint; lengths in meters.

Layout after Anipose's ``triangulate``: ``<p>_x, _y, _z, _error, _ncams, _score``, then ``M_00`` to ``M_22``,
``center_0`` to ``center_2`` and ``fnum``. ``M`` and ``center`` map to the calibration in the unit of its file:
``x_calibration = M^-1 (x + center)``. Results have no detection scores, so ``_score`` is empty. There are no further
columns, because programs that read such files (movement) reject them. Missing frame numbers are rows without points.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from posefuse.errors import FileError, choices
from posefuse.io.columns import Columns, n_rows, number_column
from posefuse.io.csv_columns import header, read_csv, write_csv
from posefuse.io.files import must_exist, reading
from posefuse.io.results import tables
from posefuse.io.results.format import ResultFacts, ResultFormat
from posefuse.io.results.rows import blocks, rows_of
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.status import is_used
from posefuse.model.stored_points import StoredPoints

_TRANSFORM = tuple(f"M_{i}{j}" for i in range(3) for j in range(3)) + tuple(f"center_{i}" for i in range(3))


def write(result: Reconstruction, person: str, path: Path, layer: LayerName) -> None:
    """Write one person.

    Raises:
        ResultError: if there are no frames, nearly all rows would be empty, or the
            result comes from a single camera.
    """
    require(ResultFacts.of(result))
    rows, _ = rows_of(result, "anipose")
    write_csv(_tables(result, result.person_ids.index(person), layer, rows), path, quoted_header=False)


def require(facts: ResultFacts) -> None:
    """Refuse results that the file cannot hold.

    Raises:
        ResultError: if the points are not in meters, there are no frames, or nearly all rows would be empty.
    """
    facts.require_meters("anipose")
    rows_of(facts, "anipose")


def _tables(result: Reconstruction, person: int, name: LayerName, rows: np.ndarray) -> Iterator[dict[str, np.ndarray]]:
    layer = result.layers[name]
    transform = dict(zip(_TRANSFORM, _to_calibration(result), strict=True))
    row = 0
    ranges = zip(
        blocks(layer.points_m, rows),
        blocks(layer.reprojection_error_px, rows),
        blocks(layer.view_status, rows, -1),
        strict=True,
    )
    for points, errors, views in ranges:
        length = len(points)
        columns: dict[str, np.ndarray] = {}
        used = is_used(views[:, person]).sum(axis=-1).astype(np.float64)
        used[np.isnan(points[:, person]).any(axis=-1)] = np.nan
        for k, keypoint in enumerate(result.skeleton.keypoints):
            columns |= {f"{keypoint}_{axis}": points[:, person, k, i] for i, axis in enumerate("xyz")}
            columns |= {f"{keypoint}_error": errors[:, person, k], f"{keypoint}_ncams": used[:, k]}
            columns[f"{keypoint}_score"] = np.full(length, np.nan)
        columns |= {key: np.full(length, value) for key, value in transform.items()}
        columns["fnum"] = result.frame_numbers[0] + np.arange(row, row + length)
        yield columns
        row += length


def _to_calibration(result: Reconstruction) -> list[float]:
    """Return M in row order, then the center."""
    matrix, center = result.rig.meters_per_unit * np.eye(3), np.zeros(3)
    if result.alignment is not None:
        matrix = result.alignment.scale * result.rig.meters_per_unit * result.alignment.rotation
        # Adding 0.0 avoids writing -0.0.
        center = 0.0 - result.alignment.shift_m
    return [*matrix.ravel().tolist(), *center.tolist()]


def matches(path: Path) -> bool:
    """Return whether a file is in this format."""
    return {"fnum", *_TRANSFORM} <= set(header(path))


def read(path: Path) -> StoredPoints:
    """Read a file of Anipose or posefuse; the person is named after the file.

    Raises:
        FileError: if it is not such a file, or is truncated.
    """
    must_exist(path, "Anipose 3D CSV file")
    names = header(path)
    keypoints = [
        name[:-2] for name in names if name.endswith("_x") and {f"{name[:-2]}_y", f"{name[:-2]}_z"} <= {*names}
    ]
    if not keypoints or "fnum" not in names:
        raise FileError(
            f"{path} is not an Anipose 3D CSV file: it lacks <bodypart>_x, _y, _z or fnum; its columns are "
            f"{choices(names)}."
        )
    table = read_csv(path, words=(), numbers=names)
    with reading(path, "Anipose 3D CSV file"):
        return _points(path, table, tuple(keypoints))


def _points(path: Path, table: Columns, keypoints: tuple[str, ...]) -> StoredPoints:
    def stack(*kinds: str) -> np.ndarray | None:
        """Return columns as an array of shape (frame, 1, keypoint, kind)."""
        names = [f"{keypoint}_{kind}" for keypoint in keypoints for kind in kinds]
        if not set(names) <= set(table):
            return None
        values = np.stack([number_column(table, name) for name in names], axis=-1)
        return values.reshape(n_rows(table), 1, len(keypoints), len(kinds))

    points, errors, used = stack("x", "y", "z"), stack("error"), stack("ncams")
    assert points is not None
    return StoredPoints(
        keypoints=keypoints,
        person_ids=(path.stem,),
        frame_numbers=tables.increasing(tables.whole(number_column(table, "fnum"), path, "fnum"), path),
        time_s=np.full(n_rows(table), np.nan),
        points_m=points,
        n_views=None if used is None else tables.counts(used[..., 0], path),
        reprojection_error_px=None if errors is None else errors[..., 0],
    )


FORMAT = ResultFormat(
    name="anipose",
    files="*.csv, one per person",
    conventions="meters, world axes; one row per frame; M and center map to the calibration in its own unit",
    lacks="times, status, covariances, which views",
    require=require,
    additional_name="anipose.csv",
    endings=(".csv",),
    name_words=("anipose",),
    matches=matches,
    read=read,
    write_person=write,
)
