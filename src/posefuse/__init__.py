"""posefuse: 3D people and animals from several calibrated cameras' 2D keypoints.

>>> import posefuse
>>> rig = posefuse.read_cameras("calibration.toml")                      # doctest: +SKIP
>>> detections = posefuse.read_detections("keypoints", "body_25")        # doctest: +SKIP
>>> result = posefuse.reconstruct(rig, detections.with_rate(60))         # doctest: +SKIP
>>> posefuse.write(result, "person.trc")                                 # doctest: +SKIP

Names are loaded when first used, so that importing the package starts no compiler.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from posefuse.calibration.options import RefineOptions as RefineOptions
    from posefuse.calibration.outcome import Refinement as Refinement
    from posefuse.edits import apply_edits as apply_edits
    from posefuse.errors import PosefuseError as PosefuseError
    from posefuse.errors import PosefuseWarning as PosefuseWarning
    from posefuse.evaluation.accuracy import evaluate as evaluate
    from posefuse.evaluation.own_account import own_account as own_account
    from posefuse.evaluation.people import ScoringOptions as ScoringOptions
    from posefuse.evaluation.people import score_people as score_people
    from posefuse.evaluation.together import PeoplePoints as PeoplePoints
    from posefuse.evaluation.together import people_points as people_points
    from posefuse.io.calibration.read import read_cameras as read_cameras
    from posefuse.io.edits import read_edits as read_edits
    from posefuse.io.keypoints.read import read_detections as read_detections
    from posefuse.io.options import read_options as read_options
    from posefuse.io.results.netcdf import read_reconstruction as read_reconstruction
    from posefuse.io.results.read import read_points as read_points
    from posefuse.io.results.write import write as write
    from posefuse.model.align_options import AlignOptions as AlignOptions
    from posefuse.model.alignment import Alignment as Alignment
    from posefuse.model.cameras import Camera as Camera
    from posefuse.model.cameras import CameraRig as CameraRig
    from posefuse.model.cameras import LensModel as LensModel
    from posefuse.model.detections import Detections as Detections
    from posefuse.model.frames import Frame as Frame
    from posefuse.model.noise import NoiseModel as NoiseModel
    from posefuse.model.options import NoiseOptions as NoiseOptions
    from posefuse.model.options import Options as Options
    from posefuse.model.options import TriangulationOptions as TriangulationOptions
    from posefuse.model.postprocess_options import PostprocessOptions as PostprocessOptions
    from posefuse.model.reconstruction import Layer as Layer
    from posefuse.model.reconstruction import Reconstruction as Reconstruction
    from posefuse.model.skeletons import Skeleton as Skeleton
    from posefuse.model.skeletons import find_skeleton as find_skeleton
    from posefuse.model.status import PointStatus as PointStatus
    from posefuse.model.status import Source as Source
    from posefuse.model.status import ViewStatus as ViewStatus
    from posefuse.model.stored_points import StoredPoints as StoredPoints
    from posefuse.model.subject_options import SubjectOptions as SubjectOptions
    from posefuse.model.timeline import align_views as align_views
    from posefuse.model.tracker_options import TrackerOptions as TrackerOptions
    from posefuse.model.tracks import Tracks as Tracks
    from posefuse.model.tracks import TrackState as TrackState
    from posefuse.model.trajectory_options import TrajectoryOptions as TrajectoryOptions
    from posefuse.pipeline import Tracker as Tracker
    from posefuse.pipeline import calibrate_noise as calibrate_noise
    from posefuse.pipeline import reconstruct as reconstruct
    from posefuse.pipeline import triangulate as triangulate
    from posefuse.refining import refine_calibration as refine_calibration
    from posefuse.synthetic.crowd_options import CrowdFaults as CrowdFaults
    from posefuse.synthetic.crowd_options import CrowdOptions as CrowdOptions
    from posefuse.synthetic.crowds import crowd_of_points as crowd_of_points
    from posefuse.synthetic.crowds import simulate_crowd as simulate_crowd
    from posefuse.synthetic.options import SceneOptions as SceneOptions
    from posefuse.synthetic.scenes import simulate as simulate
    from posefuse.tracking.records import People as People
    from posefuse.tracking.records import Person as Person

_PLACES = {
    "edits": ("apply_edits",),
    "errors": ("PosefuseError", "PosefuseWarning"),
    "evaluation.accuracy": ("evaluate",),
    "evaluation.own_account": ("own_account",),
    "evaluation.people": ("ScoringOptions", "score_people"),
    "evaluation.together": ("PeoplePoints", "people_points"),
    "io.calibration.read": ("read_cameras",),
    "io.edits": ("read_edits",),
    "io.keypoints.read": ("read_detections",),
    "io.options": ("read_options",),
    "io.results.netcdf": ("read_reconstruction",),
    "io.results.read": ("read_points",),
    "io.results.write": ("write",),
    "model.align_options": ("AlignOptions",),
    "model.alignment": ("Alignment",),
    "model.cameras": ("Camera", "CameraRig", "LensModel"),
    "model.detections": ("Detections",),
    "model.frames": ("Frame",),
    "model.noise": ("NoiseModel",),
    "model.options": ("NoiseOptions", "Options", "TriangulationOptions"),
    "model.postprocess_options": ("PostprocessOptions",),
    "model.reconstruction": ("Layer", "Reconstruction"),
    "model.skeletons": ("Skeleton", "find_skeleton"),
    "model.status": ("PointStatus", "Source", "ViewStatus"),
    "model.stored_points": ("StoredPoints",),
    "model.subject_options": ("SubjectOptions",),
    "model.timeline": ("align_views",),
    "model.tracker_options": ("TrackerOptions",),
    "model.tracks": ("TrackState", "Tracks"),
    "model.trajectory_options": ("TrajectoryOptions",),
    "calibration.options": ("RefineOptions",),
    "calibration.outcome": ("Refinement",),
    "pipeline": ("Tracker", "calibrate_noise", "reconstruct", "triangulate"),
    "refining": ("refine_calibration",),
    "synthetic.crowd_options": ("CrowdFaults", "CrowdOptions"),
    "synthetic.crowds": ("crowd_of_points", "simulate_crowd"),
    "synthetic.options": ("SceneOptions",),
    "synthetic.scenes": ("simulate",),
    "tracking.records": ("People", "Person"),
}
_MODULE_OF = {name: module for module, names in _PLACES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("posefuse")
    if name in _MODULE_OF:
        return getattr(import_module(f"posefuse.{_MODULE_OF[name]}"), name)
    raise AttributeError(f"module 'posefuse' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*_MODULE_OF, "__version__"])
