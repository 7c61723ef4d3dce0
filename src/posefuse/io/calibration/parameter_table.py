"""Camera parameter tables in parquet (``camera_params.parquet``): one row per camera, R, T or rvec as in OpenCV.

Columns: ``name`` (or ``camera``), ``K`` (or ``fx fy cx cy``), ``dist`` (or ``DC``, ``distortion``), ``R`` (9) or
``rvec`` (3), ``T`` (or ``tvec``), ``width`` and ``height``. They may be nested in structs, such as ``intrinsic`` with
``camera_matrix`` and ``distortion_coefficients``, and ``extrinsic`` with ``rvec`` and ``tvec``. Tables of the
ActualTest notebook have rotation vectors averaged component by component over several images of a board. This is not a
mean of rotations, so a note says so.
"""

from pathlib import Path
from typing import Any

from posefuse.errors import FileError, choices
from posefuse.io.arrow import import_pyarrow
from posefuse.io.calibration.camera_records import LARGEST_BYTES, CameraRecord, build_rig
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.parquet_files import check_parquet
from posefuse.io.parquet_footer import schema
from posefuse.model.cameras import CameraRig
from posefuse.model.options.options import LengthUnit

_NAMES = {
    "name": ("name", "camera", "camera_name", "port"),
    "matrix": ("K", "camera_matrix", "intrinsic"),
    "distortion": ("DC", "dist", "distortion", "distortion_coefficients"),
    "rotation": ("R", "rvec"),
    "translation": ("T", "tvec"),
}
_BIASED = (
    "{}: rotations in such tables are often averages of rotation vectors, which are biased if the samples differ by "
    "more than a degree. Refine the calibration if errors are large."
)


def matches(path: Path) -> bool:
    """Return whether the file is in this format."""
    if path.suffix != ".parquet" or not path.is_file() or path.stat().st_size > LARGEST_BYTES:
        return False
    columns = set(_columns(path))
    return all(columns & set(_NAMES[field]) for field in ("rotation", "translation")) and bool(
        columns & set(_NAMES["matrix"]) or {"fx", "fy", "cx", "cy"} <= columns
    )


def _columns(path: Path) -> list[str]:
    """Return the names of the columns, and of the fields of columns that are structs."""
    try:
        return [name for field, inner in schema(path) for name in (inner or [field])]
    except (OSError, ValueError):
        return []


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras in the order of the file.

    Raises:
        FileError: if the file does not conform to its format.
        CameraError: if a camera's parameters are invalid.
    """
    pq = import_pyarrow().parquet
    try:
        check_parquet(path)
        rows: list[dict[str, Any]] = pq.read_table(path).to_pylist()
    except FileError:
        raise
    except Exception as error:  # a corrupt file can raise any exception
        raise FileError(f"{path} is not a valid parquet file: {str(error)[:120]}. Is it truncated?") from None
    rows = [_unnested(path, i, row) for i, row in enumerate(rows)]
    records = [_camera(path, i, row) for i, row in enumerate(rows)]
    vectors = any("rvec" in row for row in rows)
    return build_rig(path, records, unit, "m", notes=(_BIASED.format(path.name),) if vectors else ())


def _unnested(path: Path, index: int, row: dict[str, Any]) -> dict[str, Any]:
    """Return a row with the fields of its structs as columns.

    Raises:
        FileError: if two fields have the same name.
    """
    flat = {name: value for name, value in row.items() if not isinstance(value, dict)}
    for struct, value in row.items():
        for name, inner in value.items() if isinstance(value, dict) else ():
            if flat.get(name) is not None and inner is not None:
                raise FileError(f"{path}, row {index}: {struct}.{name} repeats the field {name!r}.")
            flat[name] = inner if inner is not None else flat.get(name)
    return flat


def _camera(path: Path, index: int, row: dict[str, Any]) -> CameraRecord:
    def first(field: str) -> Any:
        return next((row[name] for name in _NAMES[field] if row.get(name) is not None), None)

    name = first("name")
    matrix = first("matrix")
    if matrix is None:
        missing = [key for key in ("fx", "fy", "cx", "cy") if row.get(key) is None]
        if missing:
            raise FileError(f"{path}, row {index} has no K and no {choices(missing)}.")
        matrix = [[row["fx"], 0.0, row["cx"]], [0.0, row["fy"], row["cy"]], [0.0, 0.0, 1.0]]
    size = (row["width"], row["height"]) if row.get("width") and row.get("height") else None
    distortion = first("distortion")
    return CameraRecord(
        str(index if name is None else name), _flat(matrix), _flat(first("rotation")), _flat(first("translation")),
        () if distortion is None else _flat(distortion), size,
    )  # fmt: skip


def _flat(values: Any) -> Any:
    """Flatten nested lists, which may be ragged in parquet."""
    if not isinstance(values, list):
        return values
    return [number for value in values for number in (_flat(value) if isinstance(value, list) else [value])]


FORMAT = CalibrationFormat(
    name="parameter_table",
    files="camera_params.parquet",
    conventions="meters; R T or rvec, world to camera; up axis unknown: `up`",
    recognized_by="parquet columns or structs with R, T or rvec",
    matches=matches,
    read=read,
)
