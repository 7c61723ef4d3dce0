"""Wrong types and swapped arguments of every public callable are errors of posefuse, never of Python."""

import enum
import inspect
import pickle
import warnings
from collections.abc import Callable, Iterator, Mapping
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import posefuse
from posefuse.arguments import Shape, checked
from posefuse.errors import ArgumentError, PosefuseError
from posefuse.evaluation.accuracy import truth_from_result
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.model.stored_points import stored_points
from posefuse.synthetic.options import CLEAN, SceneOptions
from tests.people import simulate_walkers, track_perfectly

WRONG = {
    "None": None,
    "string": "text",
    "float": 1.5,
    "list": [1, 2],
    "array": np.zeros((2, 5)),
    "object": SimpleNamespace(),
}
OTHER_ERRORS = {f"CheckpointFolder.{method}": pickle.UnpicklingError for method in ("save", "save_file", "begin_save")}
"""Errors of Python that are documented: a checkpoint holds no objects of other programs."""
NOT_CALLED = {"CheckpointFolder.remove", "CheckpointFolder.begin", "Outcome.open"}
"""Methods without arguments, or that delete files."""


def public_callables() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Yield functions, constructors, and public methods of the public classes."""
    for name in posefuse.__all__:
        owner = getattr(posefuse, name)
        if not inspect.isclass(owner):
            yield name, owner
        elif not issubclass(owner, enum.Enum | Exception):
            yield name, owner
            for method, member in vars(owner).items():
                if inspect.isfunction(getattr(member, "__func__", member)) and not method.startswith("_"):
                    yield f"{name}.{method}", member


NAMES = sorted(name for name, _ in public_callables())


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> SimpleNamespace:
    """Return valid values of all kinds, small enough for hundreds of calls."""
    folder = tmp_path_factory.mktemp("arguments")
    scene = posefuse.simulate(SceneOptions(duration_s=0.3, cameras=3, detector=CLEAN))
    crowd = simulate_walkers(people=2, seconds=0.3)
    people = track_perfectly(crowd)
    anipose.write(scene.rig, folder / "calibration.toml")
    native.write(scene.detections, folder / "keypoints.nc")
    rows = "\n".join(f"{frame / 30} {frame}" for frame in range(9))
    (folder / "walk.mot").write_text(f"inDegrees=yes\nendheader\ntime knee_angle_r\n{rows}\n")
    result = scene.truth
    posefuse.write(result, folder / "reconstruction.nc")
    posefuse.write(result, folder / "points.csv")
    (folder / "edits.toml").write_text('[[edit]]\ndo = "drop"\nperson = "person_1"\n')
    (folder / "options.toml").write_text("start_s = 0.1\n")
    frame = posefuse.Frame.of(crowd.detections, 1)
    tracker = posefuse.Tracker(crowd.rig, crowd.detections.skeleton)
    layer = result.layers["measured"]
    return SimpleNamespace(
        folder=folder, scene=scene, crowd=crowd, people=people, result=result, frame=frame, tracker=tracker,
        layer=layer, points=stored_points(result, "measured"), paired=posefuse.people_points(people, crowd.truth),
        checkpoint=posefuse.CheckpointFolder(folder / "parts", "key"),
        inferred=posefuse.InferredUp(np.array([0.0, 0.0, 1.0]), 1.0),
        alignment=posefuse.Alignment(np.eye(3), np.zeros(3)),
        angles=posefuse.AngleSeries("walk", np.arange(4.0), ("knee_angle_r",), np.zeros((4, 1))),
        covariance=posefuse.CameraCovariance("cam_0", ("fx",), np.eye(1)),
        joint_angles=posefuse.JointAngles(
            ("knee_angle_r",), ("opensim",), "solved", *np.zeros((2, 4, 1, 1)), np.zeros((4, 1, 1), np.int8),
            np.zeros((4, 1, 3)),
        ),
    )  # fmt: skip


def arguments_of(w: SimpleNamespace, name: str) -> dict[str, Any]:
    """Return a valid value for each argument that the name alone does not determine."""
    truth = w.result.layers["measured"].points_m
    values: dict[str, dict[str, Any]] = {
        "evaluate": {"truth": truth_from_result(w.result, w.result)},
        "evaluate_files": {"truth": w.folder / "reconstruction.nc"},
        "compare_angles": {"result": w.angles, "reference": w.angles},
        "compare_angle_files": {"result": w.folder / "walk.mot", "references": [w.folder / "walk.mot"]},
        "compare_results": {"first": w.folder / "reconstruction.nc", "second": w.folder / "reconstruction.nc"},
        "opensim_results": {"results": [w.folder / "reconstruction.nc"], "output": w.folder / "opensim"},
        "people_points": {"result": w.people, "truth": w.crowd.truth},
        "read_cameras": {"path": w.folder / "calibration.toml"},
        "read_detections": {"path": w.folder / "keypoints.nc"},
        "read_edits": {"path": w.folder / "edits.toml"},
        "read_options": {"path": w.folder / "options.toml"},
        "read_points": {"path": w.folder / "points.csv"},
        "read_reconstruction": {"path": w.folder / "reconstruction.nc"},
        "write": {"path": w.folder / "written.nc"},
        "crowd_of_points": {"points_m": truth, "rate_hz": 30.0},
        "Alignment.points": {"points_m": truth},
        "Detections.views": {"names": w.scene.rig.names[:2]},
        "Detections.rows": {"rows": np.array([0, 1])},
        "Detections.from_dense": {"keypoints_px": w.scene.detections.dense()[0], "confidence": None},
        "Frame.of_people": {
            "keypoints_px": [np.zeros((1, 4, 2)), np.zeros((0, 4, 2))], "confidence": [np.zeros((1, 4)), None],
            "time_s": 0.0, "track_ids": [[1], []], "number": 3,
        },
        "Layer.concatenate": {"parts": [w.layer]},
        "Reconstruction.concatenate": {"parts": [w.result]},
        "Tracks.concatenate": {"parts": [w.people.tracks]},
        "Tracks.rows": {"detections": w.crowd.detections},
        "Tracker.update": {"frame": w.frame},
        "CheckpointFolder.save_file": {"file": w.folder / "keypoints.nc"},
        "CheckpointFolder.load_file": {"target": w.folder / "loaded"},
        "Camera.from_opencv": {
            "name": "a", "size_px": (10, 10), "matrix": np.array([[9.0, 0, 5], [0, 9, 5], [0, 0, 1]]),
            "distortion": np.zeros(5), "rotation": np.zeros(3), "translation": np.ones(3),
        },
        "Camera.rays": {"pixels": np.zeros((4, 2))},
        "score_people": {"options": posefuse.ScoringOptions(pck_m=(0.1,))},
    }  # fmt: skip
    return values.get(name, {})


BY_NAME: dict[str, Callable[[SimpleNamespace], Any]] = {
    "rig": lambda w: w.scene.rig,
    "detections": lambda w: w.scene.detections,
    "result": lambda w: w.result,
    "skeleton": lambda w: w.scene.detections.skeleton,
    "other": lambda w: w.scene.detections.skeleton,
    "view_names": lambda w: w.scene.rig.names,
    "names": lambda w: w.scene.rig.names[:1],
    "name": lambda w: w.scene.rig.names[0],
    "keypoint": lambda w: "nose",
    "points_m": lambda w: w.result.layers["measured"].points_m,
    "start": lambda w: 0,
    "stop": lambda w: 2,
    "size": lambda w: 2,
    "spans": lambda w: [(0, 1), (2, 3)],
    "row": lambda w: 1,
    "view": lambda w: 1,
    "index": lambda w: 1,
    "number": lambda w: 1,
    "rate_hz": lambda w: 30.0,
    "data": lambda w: w.paired,
    "edits": lambda w: posefuse.read_edits(w.folder / "edits.toml"),
    "methods": lambda w: ("simple",),
    "recording": lambda w: w.folder / "empty",
    "output": lambda w: w.folder / "out",
    "folder": lambda w: w.folder / "parts",
    "key": lambda w: "key",
    "value": lambda w: 3,
    "up_axis": lambda w: "z",
    "frame": lambda w: w.frame,
}


def valid_call(w: SimpleNamespace, name: str, member: Any) -> tuple[Callable[..., Any], dict[str, Any]]:
    """Return a callable and valid keyword arguments."""
    owner, _, method = name.partition(".")
    instances = {
        "Alignment": w.alignment, "AngleSeries": w.angles, "Camera": w.scene.rig.cameras[0], "CameraRig": w.scene.rig,
        "CameraCovariance": w.covariance,
        "CheckpointFolder": w.checkpoint, "Detections": w.scene.detections, "Finding": None, "Frame": w.frame,
        "InferredUp": w.inferred, "JointAngles": w.joint_angles, "Layer": w.layer,
        "NoiseModel": w.people.noise, "PeoplePoints": w.paired,
        "Reconstruction": w.result, "Skeleton": w.scene.detections.skeleton, "StoredPoints": w.points,
        "Synchronization": posefuse.Synchronization(posefuse.SyncOptions(), posefuse.SyncOptions(), ()),
        "Tracker": w.tracker, "Tracks": w.people.tracks,
    }  # fmt: skip
    instance = posefuse.__getattr__(owner)() if "Options" in owner and method else instances.get(owner)
    target = getattr(getattr(posefuse, owner) if instance is None else instance, method) if method else member
    special = arguments_of(w, name)
    found = {}
    for each in inspect.signature(target).parameters.values():
        if each.name in special:
            found[each.name] = special[each.name]
        elif not method and instance is not None and hasattr(instance, each.name):
            found[each.name] = getattr(instance, each.name)
        elif each.default is not inspect.Parameter.empty:
            found[each.name] = each.default
        else:
            found[each.name] = BY_NAME.get(each.name, lambda _: None)(w)
    return target, found


def variants(valid: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield calls with one wrong argument, and with two swapped."""
    for name, value in valid.items():
        for kind, wrong in WRONG.items():
            if wrong is not value:
                yield f"{name}={kind}", {**valid, name: wrong}
    for a, b in combinations(valid, 2):
        if valid[a] is not valid[b]:
            yield f"{a}<->{b}", {**valid, a: valid[b], b: valid[a]}


@pytest.mark.parametrize("name", [name for name in NAMES if name not in NOT_CALLED])
def test_wrong_arguments_raise_errors_of_posefuse(name: str, world: SimpleNamespace, monkeypatch, tmp_path: Path):
    monkeypatch.chdir(tmp_path)
    target, valid = valid_call(world, name, dict(public_callables())[name])
    raw = []
    for what, arguments in variants(valid):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                made = target(**arguments)
                if inspect.isgenerator(made):
                    list(made)
        except (PosefuseError, OTHER_ERRORS.get(name, PosefuseError)):
            continue
        except Exception as error:
            raw.append(f"{what}: {type(error).__name__}: {error}")
    assert raw == []


def test_message_names_the_argument_what_is_expected_and_the_swap(world):
    with pytest.raises(ArgumentError, match=r"reconstruct: rig must be a CameraRig, got 'rig'\.$"):
        posefuse.reconstruct("rig", world.scene.detections)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="rig and detections seem to be swapped"):
        posefuse.reconstruct(world.scene.detections, world.scene.rig)
    with pytest.raises(ArgumentError, match=r"points_m must be an array of numbers of shape \(\.\.\., 3\), got"):
        world.scene.rig.project(np.zeros((2, 5)))


def test_signatures_stay_visible():
    assert list(inspect.signature(posefuse.reconstruct).parameters)[:3] == ["rig", "detections", "options"]
    assert "Reconstruct people in 3D" in (posefuse.reconstruct.__doc__ or "")
    assert next(iter(inspect.signature(posefuse.Layer).parameters)) == "points_m"


def test_missing_arguments_stay_errors_of_python():
    @checked
    def double(number: float) -> float:
        return 2 * number

    assert double(2) == 4
    with pytest.raises(TypeError, match="missing 1 required positional argument"):
        double()  # type: ignore[call-arg]
    assert Shape(..., 3).fits((4, 3))
    assert not Shape(..., 3).fits(())
    assert not Shape(None, 3).fits((1, 2, 3))
