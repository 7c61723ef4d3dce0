"""A person of a result as OpenSim needs it: scaled model, coordinates, marker errors, what the points leave open."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from posefuse.arrays import ranges
from posefuse.biomechanics.anatomy.scaled import ScaledAnatomy
from posefuse.biomechanics.inverse_kinematics import MODEL_SD_M, person_points, posterior_means, solve
from posefuse.biomechanics.marker_model import MarkerModel
from posefuse.biomechanics.subject_fit import SubjectFit
from posefuse.io.results.axes import y_up_from_world
from posefuse.model.detections import CHUNK_FRAMES
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.pipeline.subjects import Subjects

_WINDOW = 512
_OPEN_SD = np.radians(6.0)
"""Standard deviation of a coordinate from points alone, from which on it follows the reference."""
_FOLLOWED_SD = np.radians(2.0)
"""Standard deviation with which inverse kinematics follows reference coordinates."""
_LEAST_INFORMATION = np.pi**-2
_MOST_SAMPLES = 40
_VARIANCES = (0, 3, 5)


@dataclass(frozen=True, eq=False)
class OpenSimPerson:
    """A person in the axes of OpenSim's files, y up.

    Attributes:
        scaled: model with the person's sizes and markers; its defaults are the pose of the first frame.
        degrees: shape (frame, coordinate): our coordinates in degrees, lengths in m; NaN without enough points.
        marker_sd_m: standard deviation of each marker along an axis: the median over frames, with that of the model.
        points_sd_deg: standard deviation of each coordinate from the points alone, without any knowledge of movement.
        followed: coordinates that the points do not determine.
    """

    scaled: ScaledAnatomy
    degrees: np.ndarray
    marker_sd_m: dict[str, float]
    points_sd_deg: dict[str, float]
    followed: tuple[str, ...]

    def coordinate_weights(self, marker_weights: dict[str, float]) -> dict[str, float]:
        """Return the weights of the followed coordinates; OpenSim divides the marker terms by the sum of weights."""
        smallest = min(self.marker_sd_m.values())
        weight = float(smallest**2 / (_FOLLOWED_SD**2 * sum(marker_weights.values())))
        return dict.fromkeys(self.followed, weight)


def opensim_person(result: Reconstruction, layer: Layer, index: int, subjects: Subjects) -> OpenSimPerson | None:
    """Return a person of a result, or return None if no frame has enough points.

    Args:
        result: a result with a known up axis.
        layer: its layer.
        index: index of the person.
        subjects: the people of the result, estimated from this layer.
    """
    fit, vertical = subjects.fits[index], subjects.verticals[index]
    sds: list[np.ndarray] = []
    for start, stop in ranges(result.n_frames, CHUNK_FRAMES):
        covariance = np.asarray(layer.covariance_m2[start:stop])[:, index]
        sds.append(np.sqrt(covariance[:, fit.model.columns][..., _VARIANCES].mean(axis=-1)))
    radians = np.concatenate(
        [_coordinates(fit, *_window(layer, index, *each), vertical) for each in ranges(result.n_frames, _WINDOW)]
    )
    known = np.asarray(np.isfinite(radians).all(axis=1))
    if not known.any():
        return None
    turned = y_up_from_world(result.rig.up_axis) @ vertical.T
    radians = _in_file_axes(fit, radians, known, turned)
    sample = np.flatnonzero(known)
    sample = sample[np.linspace(0, len(sample) - 1, min(_MOST_SAMPLES, len(sample))).astype(int)]
    return OpenSimPerson(
        _scaled(result.person_ids[index], fit, radians[sample[0]], result.options.subject.mass_kg),
        np.where(fit.model.anatomy.is_translation, radians, np.degrees(radians)),
        _marker_sds(fit.model, np.concatenate(sds)),
        *_open_coordinates(fit, layer, index, sample, vertical),
    )


def _window(layer: Layer, index: int, start: int, stop: int) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(layer.points_m[start:stop])[:, index], np.asarray(layer.covariance_m2[start:stop])[:, index]


def _coordinates(fit: SubjectFit, points_m: np.ndarray, covariance_m2: np.ndarray, vertical: np.ndarray) -> np.ndarray:
    """Return the coordinates of consecutive frames; those of the pelvis in axes with y up instead of the person's."""
    person = person_points(fit.model, points_m, covariance_m2, vertical)
    solution = posterior_means(fit.model, person, solve(fit.model, person, fit.prior))
    at = fit.model.anatomy.coordinate_index
    angles = np.array([at(f"pelvis_{name}") for name in ("tilt", "list", "rotation")])
    place = np.array([at(f"pelvis_t{axis}") for axis in "xyz"])
    out = solution.coordinates.copy()
    known = np.flatnonzero(np.isfinite(out).all(axis=1))
    if len(known):
        upright = vertical @ person.world_from_person[known]
        pelvis = upright @ solution.rotations[known, fit.model.anatomy.body_index("pelvis")]
        out[np.ix_(known, angles)] = Rotation.from_matrix(pelvis).as_euler("ZXY")
        moved = np.einsum("fij,fj->fi", upright, solution.coordinates[np.ix_(known, place)])
        out[np.ix_(known, place)] = moved + person.origin_m[known] @ vertical.T
    return out


def _in_file_axes(fit: SubjectFit, radians: np.ndarray, known: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """Return coordinates with the pelvis turned about the vertical to the axes of the files."""
    at = fit.model.anatomy.coordinate_index
    angles = np.array([at(f"pelvis_{name}") for name in ("tilt", "list", "rotation")])
    place = np.array([at(f"pelvis_t{axis}") for axis in "xyz"])
    rows = np.flatnonzero(known)
    out = radians.copy()
    pelvis = Rotation.from_matrix(turned) * Rotation.from_euler("ZXY", radians[np.ix_(rows, angles)])
    out[np.ix_(rows, angles)] = np.unwrap(pelvis.as_euler("ZXY"), axis=0)
    out[np.ix_(rows, place)] = radians[np.ix_(rows, place)] @ turned.T
    return out


def _scaled(name: str, fit: SubjectFit, first: np.ndarray, mass_kg: float | None) -> ScaledAnatomy:
    model = fit.model
    defaults = model.anatomy.defaults.copy()
    pelvis = [c for c, coordinate in enumerate(model.anatomy.coordinates) if coordinate.startswith("pelvis_")]
    defaults[pelvis] = first[pelvis]
    bodies, locations = model.markers.bodies, model.markers.locations_m
    return ScaledAnatomy(name, model.anatomy, model.scales, model.keypoints, bodies, locations, defaults, mass_kg)


def _marker_sds(model: MarkerModel, sds_m: np.ndarray) -> dict[str, float]:
    """Return the median standard deviation of each marker that has points."""
    columns = zip(model.keypoints, sds_m.T, strict=True)
    return {
        name: float(np.hypot(np.nanmedian(column), MODEL_SD_M)) for name, column in columns if np.isfinite(column).any()
    }


def _open_coordinates(
    fit: SubjectFit, layer: Layer, index: int, sample: np.ndarray, vertical: np.ndarray
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the standard deviations of coordinates from points alone, and the coordinates that they leave open.

    Each open coordinate is taken as known to find the next one. The pelvis is left out: the inclination of the trunk
    and the lumbar coordinates together determine its tilt.
    """
    anatomy = fit.model.anatomy
    frames = [_window(layer, index, int(t), int(t) + 1) for t in sample]
    points, covariance = (np.concatenate(arrays) for arrays in zip(*frames, strict=True))
    solution = solve(fit.model, person_points(fit.model, points, covariance, vertical), fit.prior)
    information = np.linalg.inv(solution.covariance[np.isfinite(solution.cost)]) - fit.prior.precision
    mean = information.mean(axis=0)
    mean = 0.5 * (mean + mean.T)
    sds = _sds(mean)
    from_points = dict(zip(anatomy.coordinates, np.degrees(sds).tolist(), strict=True))
    joint = np.array([not name.startswith("pelvis_") for name in anatomy.coordinates])
    followed: list[str] = []
    while (sds * joint).max() > _OPEN_SD:
        c = int(np.argmax(sds * joint))
        followed.append(anatomy.coordinates[c])
        mean[c, c] += 1.0 / _FOLLOWED_SD**2
        sds = _sds(mean)
    return from_points, tuple(sorted(followed, key=anatomy.coordinate_index))


def _sds(information: np.ndarray) -> np.ndarray:
    """Return standard deviations from an information matrix, at most about 180 degrees where it is singular."""
    values, vectors = np.linalg.eigh(information)
    return np.sqrt((vectors**2 / np.maximum(values, _LEAST_INFORMATION)).sum(axis=1))
