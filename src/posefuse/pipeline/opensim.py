"""Results as OpenSim's files: scaled models, inverse kinematics, and how its angles agree with those of posefuse."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from posefuse.arguments import checked
from posefuse.biomechanics.marker_model import marker_model
from posefuse.errors import ResultError
from posefuse.evaluation.angle_agreement import AngleComparison, AngleSeries, compare_angles
from posefuse.io.files import replacing_folder
from posefuse.io.motion_tables import read_joint_angles, write_coordinates
from posefuse.io.opensim.library import require_opensim
from posefuse.io.opensim.model_file import write_model
from posefuse.io.opensim.setup_file import InverseKinematicsSetup, reference_name, write_setup
from posefuse.io.opensim.tools import UserModel, open_model, run_inverse_kinematics, scale_model, weights_of
from posefuse.io.outputs import check_new_folder
from posefuse.io.results import trc
from posefuse.io.results.names import safe_names
from posefuse.io.results.open_result import open_result
from posefuse.io.results.timing import export_rate, regular_rows
from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Layer, Reconstruction
from posefuse.pipeline.opensim_person import OpenSimPerson, opensim_person
from posefuse.pipeline.subjects import Subjects, fit_subjects
from posefuse.progress import Progress, Silent

COMPARISON_FILE = "angles_comparison.csv"
_OWNED = (COMPARISON_FILE, "*.osim", "*.mot", "*.trc", "*_ik.xml", "*_ik_marker_errors.sto")
_COLUMNS = ("trial", "person", "angle", "frames", "rmse_deg", "bias_deg", "mae_deg", "r", "points_sd_deg", "followed")
_PELVIS = ("pelvis_tilt", "pelvis_list", "pelvis_rotation")


@dataclass(frozen=True)
class OpenSimOutcome:
    """What inverse kinematics gave for one person of one result.

    Attributes:
        trial: name of the result.
        person: name of the person.
        n_frames: number of frames of inverse kinematics.
        marker_rms_m: root mean square distance between markers and points.
        comparison: OpenSim's angles minus those of posefuse.
        points_sd_deg: standard deviation of each angle from the points alone, without any knowledge of movement.
        followed: coordinates that follow those of posefuse, because the points do not determine them.
    """

    trial: str
    person: str
    n_frames: int
    marker_rms_m: float
    comparison: AngleComparison
    points_sd_deg: Mapping[str, float]
    followed: tuple[str, ...]


@checked
def opensim_results(
    results: Sequence[Path],
    output: Path,
    model: Path | None = None,
    layer: LayerName | None = None,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> tuple[tuple[OpenSimOutcome, ...], tuple[str, ...]]:
    """Scale a model for every person of results, run OpenSim's inverse kinematics, and compare its angles with ours.

    Args:
        results: folders of results or of runs, or ``reconstruction.nc`` files.
        output: folder for the models, motions, markers and the comparison.
        model: the user's model with the bodies of Rajagopal et al. 2016, such as the one with muscles; by default the
            model without muscles that posefuse contains.
        layer: layer of the points; by default the best one of each result.
        overwrite: whether to replace an earlier output.
        progress: receives the progress.

    Returns:
        What was found for every person with enough points, and notes in sentences.

    Raises:
        OptionsError: if the static trial of a result cannot be used.
        FileError: if a result or the model does not exist or cannot be read.
        OutputExistsError: if the output exists and is not to be replaced.
        ResultError: if OpenSim is not installed or fails, a result has no human skeleton, no up axis or no constant
            frame rate, or the model lacks bodies.
    """
    require_opensim()
    check_new_folder(output, overwrite=overwrite, marker=COMPARISON_FILE)
    users_model = None if model is None else open_model(model)
    trials = _trials(results)
    for name, result in trials:
        _require(name, result)
    outcomes: list[OpenSimOutcome] = []
    notes: list[str] = []
    # Static trials are read before any file is written.
    fitted = [_Trial.of(name, result, layer) for name, result in trials]
    jobs = [(trial, index) for trial in fitted for index in range(len(trial.result.person_ids))]
    stems = safe_names([_stem(trial.name, trial.result.person_ids[i], len(trials)) for trial, i in jobs])
    reports = progress or Silent()
    reports.start("opensim", len(jobs))
    with replacing_folder(output, COMPARISON_FILE, _OWNED) as staging:
        for (trial, index), stem in zip(jobs, stems, strict=True):
            outcome = _person(trial, index, staging / stem, users_model)
            if outcome is None:
                person = trial.result.person_ids[index]
                notes.append(f"{trial.name}: {person} has no frame with enough points; no files.")
            else:
                outcomes.append(outcome)
            reports.advance(1)
        reports.finish()
        if not outcomes:
            raise ResultError("No person has a frame with enough points, so there is nothing for OpenSim.")
        _write_comparison(outcomes, staging / COMPARISON_FILE)
    return tuple(outcomes), tuple(notes)


@dataclass(frozen=True, eq=False)
class _Trial:
    """A result, and its people as its joint angles have them.

    Attributes:
        name: name of the result.
        result: the result.
        layer_name: name of the layer.
        layer: its points.
        subjects: the people, estimated from the layer and from the static trial that the result's options name.
    """

    name: str
    result: Reconstruction
    layer_name: LayerName
    layer: Layer
    subjects: Subjects

    @classmethod
    def of(cls, name: str, result: Reconstruction, wanted: LayerName | None) -> "_Trial":
        """Estimate the people of a result."""
        layer_name, layer = result.best_layer(wanted or result.options.layer)
        unscaled = marker_model(result.skeleton)
        assert unscaled is not None
        return cls(name, result, layer_name, layer, fit_subjects(result, unscaled, layer))


def _trials(results: Sequence[Path]) -> list[tuple[str, Reconstruction]]:
    """Return the results with different names."""
    opened = [open_result(path) for path in results]
    names = safe_names([path.absolute().parent.name for path, _ in opened])
    return [(name, result) for name, (_, result) in zip(names, opened, strict=True)]


def _stem(trial: str, person: str, n_trials: int) -> str:
    return f"{trial}_{person}" if n_trials > 1 else person


def _require(name: str, result: Reconstruction) -> None:
    """Refuse results that do not fit a full-body model.

    Raises:
        ResultError: if the points are not in meters, the keypoints are not those of a human, the up axis is unknown,
            or the frame rate is unknown or not constant.
    """
    if result.unit != "m":
        raise ResultError(f"{name}: OpenSim needs points in meters; these are in {result.unit}. Calibrate the cameras.")
    if marker_model(result.skeleton) is None:
        raise ResultError(
            f"{name}: OpenSim's full-body model needs the hips and knees of a human; skeleton "
            f"{result.skeleton.name!r} does not have them."
        )
    if result.rig.up_axis is None:
        raise ResultError(
            f"{name}: OpenSim needs the up axis, and that of this result is unknown. Reconstruct with `up`."
        )
    export_rate(result, "TRC")


def _person(trial: _Trial, index: int, stem: Path, source: UserModel | None) -> OpenSimOutcome | None:
    """Write the files of one person, or return None if no frame has enough points."""
    result = trial.result
    person = opensim_person(result, trial.layer, index, trial.subjects)
    if person is None:
        return None
    model_path = stem.with_name(f"{stem.name}.osim")
    if source is None:
        markers, free = person.scaled.marker_names, frozenset(person.scaled.anatomy.coordinates)
        write_model(person.scaled, model_path)
    else:
        markers, free = scale_model(source, person.scaled, model_path), source.free_coordinates
    only = replace(result, layers={trial.layer_name: trial.layer}, tracks=None, swaps=None, poses=None)
    trc.write(only, result.person_ids[index], stem.with_name(f"{stem.name}.trc"), trial.layer_name)
    seconds = _seconds(result, export_rate(result, "TRC"))
    followed = tuple(name for name in person.followed if name in free)
    weights = weights_of({name: sd for name, sd in person.marker_sd_m.items() if name in markers})
    known = np.flatnonzero(np.isfinite(person.degrees).all(axis=1))
    span = (float(seconds[known[0]]), float(seconds[known[-1]]))
    tasks = {name: w for name, w in person.coordinate_weights(weights).items() if name in followed}
    if followed:
        _write_reference(person, seconds, followed, stem.with_name(reference_name(stem.name)))
    setup = stem.with_name(f"{stem.name}_ik.xml")
    write_setup(InverseKinematicsSetup(stem.name, span, weights, tasks), setup)
    rms = run_inverse_kinematics(setup)
    found = level_pelvis(read_joint_angles(stem.with_name(f"{stem.name}.mot")))
    comparison = compare_angles(found, level_pelvis(_series(person, seconds)))
    return OpenSimOutcome(
        trial.name, result.person_ids[index], len(found.time_s), rms, comparison, person.points_sd_deg, followed
    )


def _seconds(result: Reconstruction, rate: float) -> np.ndarray:
    """Return the times of the frames in the TRC, shape (frame,)."""
    start = result.time_s[0] if np.isfinite(result.time_s[0]) else result.frame_numbers[0] / rate
    return np.round(start + regular_rows(result)[0] / rate, 6)


def _write_reference(person: OpenSimPerson, seconds: np.ndarray, names: Sequence[str], path: Path) -> None:
    """Write reference coordinates; frames without enough points have interpolated ones, because OpenSim needs all."""
    columns = [person.scaled.anatomy.coordinate_index(name) for name in names]
    known = np.isfinite(person.degrees).all(axis=1)
    values = [np.interp(seconds, seconds[known], person.degrees[known, c]) for c in columns]
    write_coordinates(path, seconds, names, np.stack(values, axis=1))


def _series(person: OpenSimPerson, seconds: np.ndarray) -> AngleSeries:
    """Return our angles."""
    anatomy = person.scaled.anatomy
    angles = [c for c in range(len(anatomy.coordinates)) if not anatomy.is_translation[c]]
    names = tuple(anatomy.coordinates[c] for c in angles)
    return AngleSeries("posefuse", seconds, names, person.degrees[:, angles])


def level_pelvis(series: AngleSeries) -> AngleSeries:
    """Return angles whose pelvis turns first about the vertical, so that tilt and list do not depend on the heading."""
    if not set(_PELVIS) <= set(series.angles):
        return series
    columns = np.array([series.angles.index(name) for name in _PELVIS])
    degrees = series.degrees.copy()
    known = np.flatnonzero(np.isfinite(degrees[:, columns]).all(axis=1))
    pelvis = Rotation.from_euler("ZXY", degrees[np.ix_(known, columns)], degrees=True)
    degrees[np.ix_(known, columns)] = pelvis.as_euler("YXZ", degrees=True)[:, ::-1]
    return replace(series, degrees=degrees)


def _write_comparison(outcomes: Sequence[OpenSimOutcome], path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_COLUMNS)
        for outcome in outcomes:
            for each in outcome.comparison.angles:
                values = (
                    each.rmse_deg,
                    each.bias_deg,
                    each.mae_deg,
                    each.correlation,
                    outcome.points_sd_deg[each.angle],
                )
                cells = ["" if np.isnan(value) else f"{value:.3f}" for value in values]
                followed = "yes" if each.angle in outcome.followed else "no"
                writer.writerow([outcome.trial, outcome.person, each.angle, each.n, *cells, followed])
