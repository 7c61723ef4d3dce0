"""Cameras and rigs.

Cameras follow OpenCV: x right, y down, z forward; pixel (0, 0) is the center of the top-left pixel;
``x_camera = R x_world + t``. The world is in meters and right-handed.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from typing import Annotated, Any, ClassVar, Self, overload

import numpy as np

from posefuse.arguments import Shape, checked
from posefuse.arrays import PickledByFields, frozen, kernel_array, same
from posefuse.described import Described
from posefuse.errors import CameraError, MatchError, choices, suggestion
from posefuse.model.camera_covariance import CameraCovariance, RigCovariance, checked_correlation, joined
from posefuse.model.descriptions import describe_rig, plot_rig
from posefuse.model.lenses import N_COEFFICIENTS, LensModel, lens_from_opencv
from posefuse.model.up_axis import UP_AXES, InferredUp, UpAxis, up_vector

_ROTATION_TOLERANCE = 1e-5


_LENS_CODES = {LensModel.PINHOLE: 0, LensModel.BROWN: 1, LensModel.RATIONAL: 2, LensModel.FISHEYE: 3}


@checked
@dataclass(frozen=True, eq=False)
class Camera(PickledByFields):
    """One calibrated camera.

    Attributes:
        name: name, unique in its rig.
        size_px: width and height of the image in px.
        matrix: shape (3, 3), intrinsic matrix K in px.
        camera_from_world: shape (4, 4), rigid transform, in meters.
        lens: lens model.
        distortion: coefficients in OpenCV's order (4 for fisheye, 5 for Brown, 8 for rational).

    Raises:
        CameraError: if a value is impossible for a camera.
    """

    name: str
    size_px: tuple[int, int]
    matrix: np.ndarray
    camera_from_world: np.ndarray
    lens: LensModel = LensModel.PINHOLE
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", _numbers(self.name, "matrix", self.matrix))
        object.__setattr__(self, "camera_from_world", _numbers(self.name, "camera_from_world", self.camera_from_world))
        object.__setattr__(self, "lens", _lens_model(self.name, self.lens))
        object.__setattr__(self, "distortion", tuple(_numbers(self.name, "distortion", self.distortion).tolist()))
        object.__setattr__(self, "size_px", _whole_size(self.name, self.size_px))
        _check_matrix(self.name, self.matrix)
        _check_pose(self.name, self.camera_from_world)
        wanted = N_COEFFICIENTS[self.lens]
        if len(self.distortion) != wanted:
            raise CameraError(
                f"Camera {self.name!r}: a {self.lens} lens has {wanted} distortion coefficients, "
                f"got {len(self.distortion)}: {list(self.distortion)}."
            )
        if not np.all(np.isfinite(self.distortion)):
            raise CameraError(f"Camera {self.name!r}: distortion coefficients must be finite, got {self.distortion}.")

    @classmethod
    def from_opencv(
        cls,
        name: str,
        size_px: Sequence[float],
        matrix: Any,
        distortion: Iterable[float],
        rotation: Any,
        translation: Any,
        *,
        fisheye: bool = False,
    ) -> Self:
        """Build a camera from OpenCV's parameters, world to camera.

        Args:
            name: camera name.
            size_px: width and height in px.
            matrix: intrinsic matrix K, shape (3, 3), in px.
            distortion: 0, 4, 5 or 8 coefficients; 4 if ``fisheye``.
            rotation: Rodrigues vector, shape (3,), in radians, or matrix, shape (3, 3).
            translation: shape (3,), in meters.
            fisheye: whether the coefficients are those of OpenCV's fisheye model.

        Raises:
            CameraError: if a value is impossible for a camera.
        """
        lens, coefficients = lens_from_opencv(name, distortion, fisheye=fisheye)
        pose = np.eye(4)
        turn = _numbers(name, "rotation", rotation)
        shift = _numbers(name, "translation", translation)
        if turn.size not in (3, 9) or shift.size != 3:
            raise CameraError(
                f"Camera {name!r}: rotation must have 3 numbers (Rodrigues vector) or 9 (matrix) and translation 3, "
                f"got shapes {turn.shape} and {shift.shape}."
            )
        pose[:3, :3] = rotation_from_vector(turn.reshape(3)) if turn.size == 3 else turn.reshape(3, 3)
        pose[:3, 3] = shift.reshape(3)
        return cls(name, (size_px[0], size_px[1]), np.asarray(matrix), pose, lens, coefficients)  # type: ignore[arg-type]

    @property
    def rotation(self) -> np.ndarray:
        """Shape (3, 3): R of ``x_camera = R x_world + t``."""
        return self.camera_from_world[:3, :3]

    @property
    def translation_m(self) -> np.ndarray:
        """Shape (3,): t of ``x_camera = R x_world + t``, in meters."""
        return self.camera_from_world[:3, 3]

    @property
    def center_m(self) -> np.ndarray:
        """Shape (3,): camera center in world coordinates, in meters."""
        return -self.rotation.T @ self.translation_m

    def project(self, points_m: Annotated[np.ndarray, Shape(..., 3)]) -> tuple[np.ndarray, np.ndarray]:
        """Project world points.

        Args:
            points_m: shape (..., 3), world coordinates in meters.

        Returns:
            Pixels, shape (..., 2), NaN where undefined, and lens codes, shape (...): 0 where defined, else
            MISSING, BEHIND or BEYOND of :mod:`posefuse.kernels.cameras.lens`.
        """
        from posefuse.kernels.cameras.lens import project_batch  # loads the compiler: import on first use

        points = kernel_array(points_m).reshape(-1, 3)
        pixels = np.empty((len(points), 2))
        codes = np.empty(len(points), dtype=np.int64)
        project_batch(self.packed[None], 0, points, pixels, codes)
        shape = np.shape(points_m)[:-1]
        return pixels.reshape(*shape, 2), codes.reshape(shape)

    def rays(self, pixels: Annotated[np.ndarray, Shape(..., 2)]) -> tuple[np.ndarray, np.ndarray]:
        """Return the viewing directions of pixels, unit vectors in camera coordinates.

        Args:
            pixels: shape (..., 2).

        Returns:
            Directions, shape (..., 3), NaN where undefined, and lens codes as in :meth:`project`.
        """
        from posefuse.kernels.cameras.lens import rays_batch

        flat = kernel_array(pixels).reshape(-1, 2)
        directions = np.empty((len(flat), 3))
        codes = np.empty(len(flat), dtype=np.int64)
        rays_batch(self.packed[None], 0, flat, directions, codes)
        shape = np.shape(pixels)[:-1]
        return directions.reshape(*shape, 3), codes.reshape(shape)

    @cached_property
    def packed(self) -> np.ndarray:
        """The camera as kernels read it, shape (COLUMNS,)."""
        from posefuse.kernels.cameras import lens as columns

        row = np.zeros(columns.COLUMNS)
        row[columns.LENS] = _LENS_CODES[self.lens]
        k = self.matrix
        row[columns.FX : columns.SKEW + 1] = k[0, 0], k[1, 1], k[0, 2], k[1, 2], k[0, 1]
        row[columns.K1 : columns.K1 + len(self.distortion)] = self.distortion
        coefficients = tuple(row[columns.K1 : columns.MAX_RADIUS].tolist())
        row[columns.MAX_RADIUS] = _fold_radius(int(row[columns.LENS]), coefficients)
        row[columns.ROTATION : columns.TRANSLATION] = self.rotation.ravel()
        row[columns.TRANSLATION : columns.PROJECTION] = self.translation_m
        row[columns.PROJECTION :] = (k @ self.camera_from_world[:3])[:2].ravel()
        return frozen(row)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Camera) and all(
            same(getattr(self, field.name), getattr(other, field.name)) for field in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]


@checked
@dataclass(frozen=True, repr=False)
class CameraRig(Described, PickledByFields):
    """The cameras of a recording and the world they share.

    Attributes:
        cameras: cameras in a fixed order, with unique names.
        up_axis: up axis of the world, or None if unknown (an Anipose world is a camera or a board).
        inferred_up: up direction that was inferred from people, or None if it was not; then ``up_axis`` is the axis
            nearest to it, or None if it is between axes.
        source: name of the calibration file, without folder.
        meters_per_unit: factor from the file's unit to meters.
        notes: notes of the reader.
        left_out: names of cameras with an invalid calibration; their views are not used.
        calibrated: False for a single camera without calibration, whose matrix and pose are placeholders.
        covariances: of the cameras whose calibration states it, by the name of the camera; not part of comparisons.
        correlation: shape (parameter, parameter): correlation of all parameters in ``covariances``, in their order, or
            None if only the covariance of each camera is known; not part of comparisons.

    Raises:
        CameraError: if the rig is empty, a name is repeated, the axis is unknown, or the correlation has another size.
    """

    cameras: tuple[Camera, ...]
    up_axis: UpAxis | None = None
    source: str = ""
    meters_per_unit: float = 1.0
    notes: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    calibrated: bool = True
    inferred_up: InferredUp | None = None
    covariances: tuple[CameraCovariance, ...] = field(default=(), compare=False)
    correlation: np.ndarray | None = field(default=None, compare=False)
    min_cameras: ClassVar[int] = 1

    _description, plot = describe_rig, plot_rig  # type: ignore[assignment]

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        object.__setattr__(self, "left_out", tuple(self.left_out))
        object.__setattr__(self, "covariances", tuple(self.covariances))
        if len(self.cameras) < self.min_cameras:
            raise CameraError(f"A rig needs at least one camera; {self.source or 'this one'} has none.")
        repeated = sorted({name for name in self.names if self.names.count(name) > 1})
        if repeated:
            raise CameraError(
                f"Camera names must be unique; {self.source or 'this rig'} repeats {choices(repeated)}. "
                "Rename the cameras in the calibration."
            )
        if self.up_axis is not None and self.up_axis not in UP_AXES:
            raise CameraError(f"up_axis {self.up_axis!r} is not an axis. Choose one of: {choices(UP_AXES)}.")
        if self.inferred_up is not None and self.up_axis != self.inferred_up.axis:
            raise CameraError(f"up_axis {self.up_axis!r} is not the axis of inferred_up, {self.inferred_up.axis!r}.")
        if self.correlation is not None:
            object.__setattr__(self, "correlation", checked_correlation(self.covariances, self.correlation))

    def with_up(self, up_axis: UpAxis | None, inferred_up: InferredUp | None = None) -> "CameraRig":
        """Return the rig with another up axis, or with one that was inferred."""
        return replace(self, up_axis=up_axis if inferred_up is None else inferred_up.axis, inferred_up=inferred_up)

    @property
    def up(self) -> tuple[float, float, float] | None:
        """Unit vector along the up axis; None if unknown."""
        return None if self.up_axis is None else up_vector(self.up_axis)

    @property
    def up_text(self) -> str:
        """The up axis in words, such as ``z``, ``-y (inferred)`` or ``unknown``."""
        return f"{self.up_axis or 'unknown'}{'' if self.inferred_up is None else ' (inferred)'}"

    @property
    def names(self) -> tuple[str, ...]:
        """Camera names in order."""
        return tuple(camera.name for camera in self.cameras)

    def __len__(self) -> int:
        return len(self.cameras)

    def __getitem__(self, name: str) -> Camera:
        return self.cameras[self.index(name)]

    def index(self, name: str) -> int:
        """Return the index of a camera.

        Raises:
            MatchError: if the rig has no camera of that name.
        """
        if name not in self.names:
            raise MatchError(f"No camera {name!r} in the calibration. {suggestion(name, self.names)}")
        return self.names.index(name)

    @overload
    def covariance(self) -> RigCovariance | None: ...

    @overload
    def covariance(self, name: str) -> CameraCovariance | None: ...

    def covariance(self, name: str | None = None) -> CameraCovariance | RigCovariance | None:
        """Return the covariance of the parameters of a camera, or of all cameras together; None if it is unknown."""
        if name is None:
            return None if self.correlation is None else joined(self.covariances, self.correlation)
        return next((each for each in self.covariances if each.camera == name), None)

    def select(self, names: Iterable[str]) -> "CameraRig":
        """Return a rig of the named cameras, in the given order."""
        return replace(self, cameras=tuple(self[name] for name in names))

    @cached_property
    def packed(self) -> np.ndarray:
        """The cameras as kernels read them: shape (view, COLUMNS), columns of :mod:`posefuse.kernels.cameras.lens`."""
        return frozen(np.stack([camera.packed for camera in self.cameras]))

    def project(self, points_m: Annotated[np.ndarray, Shape(..., 3)]) -> np.ndarray:
        """Project world points into every view.

        Args:
            points_m: shape (3,) for one point, otherwise (frame, ..., 3): the first axis is the frame. World
                coordinates in meters.

        Returns:
            Pixels, shape (view, 2) for one point, otherwise (frame, view, ..., 2), NaN where undefined.
        """
        return np.stack([camera.project(points_m)[0] for camera in self.cameras], axis=min(np.ndim(points_m) - 1, 1))


def rotation_from_vector(vector: np.ndarray) -> np.ndarray:
    """Return the rotation matrix, shape (3, 3), of a Rodrigues vector (axis times angle in radians)."""
    x, y, z = (float(value) for value in vector)
    angle = float(np.sqrt(x * x + y * y + z * z))
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # sin(a)/a and (1 - cos(a))/a^2 by the half angle, which is accurate near zero.
    half = np.sinc(angle / (2.0 * np.pi))
    return np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * half * half * (cross @ cross)


def vector_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """Return the Rodrigues vector, shape (3,), of a rotation matrix; the angle is at most pi."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_rotvec()


@lru_cache(maxsize=256)
def _fold_radius(lens: int, coefficients: tuple[float, ...]) -> float:
    """Return the fold of a lens model, once for each lens: adjustments move cameras many times."""
    from posefuse.kernels.cameras.lens import fold_radius

    return fold_radius(lens, np.array(coefficients))


def _numbers(camera: str, field: str, values: Any) -> np.ndarray:
    """Return a read-only float64 array."""
    try:
        return frozen(values)
    except (TypeError, ValueError):
        raise CameraError(f"Camera {camera!r}: {field} must be an array of numbers, got {values!r}.") from None


def _lens_model(camera: str, lens: Any) -> LensModel:
    if lens not in set(LensModel):
        known = [str(model) for model in LensModel]
        raise CameraError(f"Camera {camera!r}: unknown lens model {lens!r}. {suggestion(str(lens), known)}")
    return LensModel(lens)


def _whole_size(name: str, size: Sequence[float]) -> tuple[int, int]:
    try:
        width, height = (float(value) for value in size)
    except (TypeError, ValueError):
        raise CameraError(f"Camera {name!r}: size_px must be width and height, got {size!r}.") from None
    if not (width >= 1 and height >= 1 and width == round(width) and height == round(height)):
        raise CameraError(f"Camera {name!r}: size_px must be two positive whole numbers, got {width:g} x {height:g}.")
    return round(width), round(height)


def _check_matrix(name: str, matrix: np.ndarray) -> None:
    if matrix.shape != (3, 3):
        raise CameraError(f"Camera {name!r}: the matrix K must be 3 x 3, got shape {matrix.shape}.")
    if not np.all(np.isfinite(matrix)):
        raise CameraError(f"Camera {name!r}: the matrix K contains numbers that are not finite: {matrix.tolist()}.")
    if not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
        raise CameraError(
            f"Camera {name!r}: focal lengths must be positive px, got {matrix[0, 0]:g} and {matrix[1, 1]:g}. "
            "Was the camera calibrated?"
        )
    if np.any(np.abs(matrix[[1, 2, 2], [0, 0, 1]]) > 1e-9) or abs(matrix[2, 2] - 1.0) > 1e-9:
        raise CameraError(
            f"Camera {name!r}: K must be upper triangular with a last row 0 0 1, got {matrix.tolist()}. "
            "A transposed matrix (MATLAB's order) is the usual cause."
        )


def _check_pose(name: str, pose: np.ndarray) -> None:
    if pose.shape != (4, 4):
        raise CameraError(f"Camera {name!r}: camera_from_world must be 4 x 4, got shape {pose.shape}.")
    if not np.all(np.isfinite(pose)) or not np.array_equal(pose[3], [0.0, 0.0, 0.0, 1.0]):
        raise CameraError(
            f"Camera {name!r}: camera_from_world must be finite with a last row 0 0 0 1, got {pose.tolist()}."
        )
    rotation = pose[:3, :3]
    # Numbers that make no rotation may overflow on the way to being told so.
    with np.errstate(all="ignore"):
        off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        determinant = float(np.linalg.det(rotation))
    if not off <= _ROTATION_TOLERANCE or determinant < 0:
        raise CameraError(
            f"Camera {name!r}: the rotation matrix is not a proper rotation: R R^T differs from the identity by "
            f"{off:.2g} (at most "
            f"{_ROTATION_TOLERANCE:g}) and its determinant is {determinant:.4f} (expected 1). A matrix that was "
            "scaled, mirrored or typed with few digits is the usual cause."
        )
