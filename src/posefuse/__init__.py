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
    from posefuse.calibration.outcome import Refinement as Refinement
    from posefuse.editing import apply_edits as apply_edits
    from posefuse.errors import PosefuseError as PosefuseError
    from posefuse.errors import PosefuseWarning as PosefuseWarning
    from posefuse.evaluation.accuracy import evaluate as evaluate
    from posefuse.evaluation.paired_results import PeoplePoints as PeoplePoints
    from posefuse.evaluation.paired_results import people_points as people_points
    from posefuse.evaluation.people import ScoringOptions as ScoringOptions
    from posefuse.evaluation.people import score_people as score_people
    from posefuse.evaluation.self_consistency import self_consistency as self_consistency
    from posefuse.io.calibration.read import read_cameras as read_cameras
    from posefuse.io.edits import read_edits as read_edits
    from posefuse.io.keypoints.read import read_detections as read_detections
    from posefuse.io.options import read_options as read_options
    from posefuse.io.results.netcdf import read_reconstruction as read_reconstruction
    from posefuse.io.results.read import read_points as read_points
    from posefuse.io.results.write import write as write
    from posefuse.model.alignment import Alignment as Alignment
    from posefuse.model.cameras import Camera as Camera
    from posefuse.model.cameras import CameraRig as CameraRig
    from posefuse.model.cameras import LensModel as LensModel
    from posefuse.model.detections import Detections as Detections
    from posefuse.model.frames import Frame as Frame
    from posefuse.model.noise import NoiseModel as NoiseModel
    from posefuse.model.options.alignment import AlignOptions as AlignOptions
    from posefuse.model.options.noise import NoiseOptions as NoiseOptions
    from posefuse.model.options.options import Options as Options
    from posefuse.model.options.postprocess import PostprocessOptions as PostprocessOptions
    from posefuse.model.options.refinement import RefineOptions as RefineOptions
    from posefuse.model.options.subject import SubjectOptions as SubjectOptions
    from posefuse.model.options.tracker import TrackerOptions as TrackerOptions
    from posefuse.model.options.trajectory import TrajectoryOptions as TrajectoryOptions
    from posefuse.model.options.triangulation import TriangulationOptions as TriangulationOptions
    from posefuse.model.reconstruction import Layer as Layer
    from posefuse.model.reconstruction import Reconstruction as Reconstruction
    from posefuse.model.status import PointStatus as PointStatus
    from posefuse.model.status import Source as Source
    from posefuse.model.status import ViewStatus as ViewStatus
    from posefuse.model.stored_points import StoredPoints as StoredPoints
    from posefuse.model.tracks import Tracks as Tracks
    from posefuse.model.tracks import TrackState as TrackState
    from posefuse.pipeline.reconstruct import Tracker as Tracker
    from posefuse.pipeline.reconstruct import calibrate_noise as calibrate_noise
    from posefuse.pipeline.reconstruct import reconstruct as reconstruct
    from posefuse.pipeline.reconstruct import triangulate as triangulate
    from posefuse.pipeline.refine_calibration import refine_calibration as refine_calibration
    from posefuse.preprocess.timeline import align_views as align_views
    from posefuse.skeleton.skeletons import Skeleton as Skeleton
    from posefuse.skeleton.skeletons import find_skeleton as find_skeleton
    from posefuse.synthetic.crowd_options import CrowdFaults as CrowdFaults
    from posefuse.synthetic.crowd_options import CrowdOptions as CrowdOptions
    from posefuse.synthetic.crowds import crowd_of_points as crowd_of_points
    from posefuse.synthetic.crowds import simulate_crowd as simulate_crowd
    from posefuse.synthetic.options import SceneOptions as SceneOptions
    from posefuse.synthetic.scenes import simulate as simulate
    from posefuse.tracking.records import People as People
    from posefuse.tracking.records import Person as Person

_PLACES = {
    "editing": ("apply_edits",),
    "errors": ("PosefuseError", "PosefuseWarning"),
    "evaluation.accuracy": ("evaluate",),
    "evaluation.self_consistency": ("self_consistency",),
    "evaluation.people": ("ScoringOptions", "score_people"),
    "evaluation.paired_results": ("PeoplePoints", "people_points"),
    "io.calibration.read": ("read_cameras",),
    "io.edits": ("read_edits",),
    "io.keypoints.read": ("read_detections",),
    "io.options": ("read_options",),
    "io.results.netcdf": ("read_reconstruction",),
    "io.results.read": ("read_points",),
    "io.results.write": ("write",),
    "model.options.alignment": ("AlignOptions",),
    "model.alignment": ("Alignment",),
    "model.cameras": ("Camera", "CameraRig", "LensModel"),
    "model.detections": ("Detections",),
    "model.frames": ("Frame",),
    "model.noise": ("NoiseModel",),
    "model.options.options": ("NoiseOptions", "Options", "TriangulationOptions"),
    "model.options.postprocess": ("PostprocessOptions",),
    "model.reconstruction": ("Layer", "Reconstruction"),
    "skeleton.skeletons": ("Skeleton", "find_skeleton"),
    "model.status": ("PointStatus", "Source", "ViewStatus"),
    "model.stored_points": ("StoredPoints",),
    "model.options.subject": ("SubjectOptions",),
    "preprocess.timeline": ("align_views",),
    "model.options.tracker": ("TrackerOptions",),
    "model.tracks": ("TrackState", "Tracks"),
    "model.options.trajectory": ("TrajectoryOptions",),
    "model.options.refinement": ("RefineOptions",),
    "calibration.outcome": ("Refinement",),
    "pipeline.reconstruct": ("Tracker", "calibrate_noise", "reconstruct", "triangulate"),
    "pipeline.refine_calibration": ("refine_calibration",),
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
