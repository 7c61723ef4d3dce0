"""Camera parameter tables in parquet (``camera_params.parquet``): a row a camera, R, T or rvec as OpenCV's.

Columns: ``name`` (or ``camera``), ``K`` (or ``fx fy cx cy``), ``dist`` (or ``DC``, ``distortion``), ``R`` (9) or
``rvec`` (3), ``T`` (or ``tvec``), ``width`` and ``height``. Tables of the ActualTest notebook hold rotation vectors
averaged component by component over several pictures of a board; that is no mean of rotations, and is said.
"""

from pathlib import Path
from typing import Any

from posefuse.errors import FileError, choices
from posefuse.io.calibration.building import LARGEST_BYTES, Found, build_rig
from posefuse.io.calibration.format import CalibrationFormat
from posefuse.io.parquet_files import check_parquet
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
    "{}: rotations of such tables are often rvec samples averaged component by component, which is biased where the "
    "samples differ by more than a degree; refine the calibration if errors are large."
)


def matches(path: Path) -> bool:
    """Whether the file is one."""
    if path.suffix != ".parquet" or not path.is_file() or path.stat().st_size > LARGEST_BYTES:
        return False
    columns = set(_columns(path))
    return all(columns & set(_NAMES[field]) for field in ("rotation", "translation")) and bool(
        columns & set(_NAMES["matrix"]) or {"fx", "fy", "cx", "cy"} <= columns
    )


def _columns(path: Path) -> list[str]:
    import pyarrow.parquet as pq

    try:
        return list(pq.read_schema(path).names)
    except Exception:  # a broken file raises whatever its bytes lead to
        return []


def read(path: Path, unit: LengthUnit | None = None) -> CameraRig:
    """Read the cameras, in the file's order.

    Raises:
        FileError: if the file is not what its format says.
        CameraError: if a camera's numbers cannot be.
    """
    import pyarrow.parquet as pq

    try:
        check_parquet(path)
        rows: list[dict[str, Any]] = pq.read_table(path).to_pylist()
    except FileError:
        raise
    except Exception as error:  # likewise
        raise FileError(f"{path} is not a whole parquet file: {str(error)[:120]}. Was it cut short?") from None
    found = [_camera(path, i, row) for i, row in enumerate(rows)]
    vectors = any("rvec" in row for row in rows)
    return build_rig(path, found, unit, "m", notes=(_BIASED.format(path.name),) if vectors else ())


def _camera(path: Path, place: int, row: dict[str, Any]) -> Found:
    def first(field: str) -> Any:
        return next((row[name] for name in _NAMES[field] if row.get(name) is not None), None)

    name = first("name")
    matrix = first("matrix")
    if matrix is None:
        missing = [key for key in ("fx", "fy", "cx", "cy") if row.get(key) is None]
        if missing:
            raise FileError(f"{path}, row {place}: no K and no {choices(missing)}.")
        matrix = [[row["fx"], 0.0, row["cx"]], [0.0, row["fy"], row["cy"]], [0.0, 0.0, 1.0]]
    size = (row["width"], row["height"]) if row.get("width") and row.get("height") else None
    distortion = first("distortion")
    return Found(
        str(place if name is None else name), _flat(matrix), _flat(first("rotation")), _flat(first("translation")),
        () if distortion is None else _flat(distortion), size,
    )  # fmt: skip


def _flat(values: Any) -> Any:
    """Lists of lists, which parquet allows to be ragged, as one list."""
    if not isinstance(values, list):
        return values
    return [number for value in values for number in (_flat(value) if isinstance(value, list) else [value])]


FORMAT = CalibrationFormat(
    name="parameter_table",
    files="camera_params.parquet",
    conventions="meters; R T or rvec, world to camera; up axis unknown: --up",
    recognized_by="parquet columns R, T or rvec",
    matches=matches,
    read=read,
)
