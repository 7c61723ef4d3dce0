"""posefuse: 3D people and animals from 2D keypoints of several calibrated cameras.

>>> import posefuse
>>> rig = posefuse.read_cameras("calibration.toml")                      # doctest: +SKIP
>>> detections = posefuse.read_detections("keypoints", "body_25")        # doctest: +SKIP
>>> detections = detections.with_rate(60)      # only if the files state no rate  # doctest: +SKIP
>>> result = posefuse.reconstruct(rig, detections)                       # doctest: +SKIP
>>> posefuse.write(result, "person.trc")                                 # doctest: +SKIP

Points with their uncertainty, and angles:

>>> name, layer = result.best_layer()                                    # doctest: +SKIP
>>> knee = result.skeleton.keypoints.index("right_knee")                 # doctest: +SKIP
>>> layer.points_m[:, 0, knee], layer.sd_m[:, 0, knee]                   # doctest: +SKIP
>>> angles = result.joint_angles                                         # doctest: +SKIP
>>> angles.degrees[:, 0, angles.index("knee_angle_r")]                   # doctest: +SKIP

A recording in a folder takes one call:

>>> outcome = posefuse.reconstruct_recording("recording", "result")      # doctest: +SKIP

Main functions: ``read_cameras``, ``read_detections``, ``reconstruct``, ``write``, ``read_reconstruction``. The result
is a :class:`Reconstruction`; ``help(posefuse.Reconstruction)`` describes it.

Names are imported when they are first used, so that importing the package does not load the compiler.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from posefuse.biomechanics.center_of_mass import CentersOfMass as CentersOfMass
    from posefuse.biomechanics.center_of_mass import center_of_mass as center_of_mass
    from posefuse.calibration.boards.calibration import BoardCalibration as BoardCalibration
    from posefuse.calibration.outcome import Refinement as Refinement
    from posefuse.calibration.people.result import BoardShare as BoardShare
    from posefuse.calibration.people.result import PeopleCalibration as PeopleCalibration
    from posefuse.calibration.scene.calibration import SceneCalibration as SceneCalibration
    from posefuse.editing import apply_edits as apply_edits
    from posefuse.errors import PosefuseError as PosefuseError
    from posefuse.errors import PosefuseWarning as PosefuseWarning
    from posefuse.evaluation.accuracy import evaluate as evaluate
    from posefuse.evaluation.angle_agreement import AngleSeries as AngleSeries
    from posefuse.evaluation.angle_agreement import compare_angles as compare_angles
    from posefuse.evaluation.paired_results import PeoplePoints as PeoplePoints
    from posefuse.evaluation.paired_results import people_points as people_points
    from posefuse.evaluation.people import ScoringOptions as ScoringOptions
    from posefuse.evaluation.people import score_people as score_people
    from posefuse.evaluation.self_consistency import self_consistency as self_consistency
    from posefuse.io.calibration.read import read_cameras as read_cameras
    from posefuse.io.calibration.write import write_cameras as write_cameras
    from posefuse.io.checkpoints import CheckpointFolder as CheckpointFolder
    from posefuse.io.edits import read_edits as read_edits
    from posefuse.io.keypoints.read import read_detections as read_detections
    from posefuse.io.open_recording import RecordingInputs as RecordingInputs
    from posefuse.io.options import read_options as read_options
    from posefuse.io.project import read_run as read_run
    from posefuse.io.results.netcdf import read_reconstruction as read_reconstruction
    from posefuse.io.results.read import read_points as read_points
    from posefuse.io.results.write import write as write
    from posefuse.model.alignment import Alignment as Alignment
    from posefuse.model.board import Board as Board
    from posefuse.model.camera_covariance import CameraCovariance as CameraCovariance
    from posefuse.model.camera_covariance import RigCovariance as RigCovariance
    from posefuse.model.cameras import Camera as Camera
    from posefuse.model.cameras import CameraRig as CameraRig
    from posefuse.model.cameras import LensModel as LensModel
    from posefuse.model.clock_evidence import ClockEvidence as ClockEvidence
    from posefuse.model.detections import Detections as Detections
    from posefuse.model.findings import Finding as Finding
    from posefuse.model.frames import Frame as Frame
    from posefuse.model.joint_angles import AngleStatus as AngleStatus
    from posefuse.model.joint_angles import JointAngles as JointAngles
    from posefuse.model.noise import NoiseModel as NoiseModel
    from posefuse.model.options.alignment import AlignOptions as AlignOptions
    from posefuse.model.options.association import AssociationOptions as AssociationOptions
    from posefuse.model.options.association import RptOptions as RptOptions
    from posefuse.model.options.calibration import CalibrateOptions as CalibrateOptions
    from posefuse.model.options.calibration import PeopleOptions as PeopleOptions
    from posefuse.model.options.detection import DetectOptions as DetectOptions
    from posefuse.model.options.left_right import SideOptions as SideOptions
    from posefuse.model.options.noise import NoiseOptions as NoiseOptions
    from posefuse.model.options.options import Options as Options
    from posefuse.model.options.pairs import PairOptions as PairOptions
    from posefuse.model.options.pairs import SdsOptions as SdsOptions
    from posefuse.model.options.postprocess import ButterworthOptions as ButterworthOptions
    from posefuse.model.options.postprocess import HampelOptions as HampelOptions
    from posefuse.model.options.postprocess import KalmanOptions as KalmanOptions
    from posefuse.model.options.postprocess import MedianOptions as MedianOptions
    from posefuse.model.options.postprocess import OneEuroOptions as OneEuroOptions
    from posefuse.model.options.postprocess import PostprocessOptions as PostprocessOptions
    from posefuse.model.options.postprocess import SavgolOptions as SavgolOptions
    from posefuse.model.options.refinement import RefineOptions as RefineOptions
    from posefuse.model.options.run import RunOptions as RunOptions
    from posefuse.model.options.specification import SpecificationOptions as SpecificationOptions
    from posefuse.model.options.stream import StreamOptions as StreamOptions
    from posefuse.model.options.subject import SubjectOptions as SubjectOptions
    from posefuse.model.options.sync import SyncOptions as SyncOptions
    from posefuse.model.options.tracker import TrackerOptions as TrackerOptions
    from posefuse.model.options.tracking_motion import MotionOptions as MotionOptions
    from posefuse.model.options.tracking_motion import PartOptions as PartOptions
    from posefuse.model.options.tracking_stages import CameraMonitorOptions as CameraMonitorOptions
    from posefuse.model.options.tracking_stages import FastMotionOptions as FastMotionOptions
    from posefuse.model.options.tracking_stages import IdentityAuditOptions as IdentityAuditOptions
    from posefuse.model.options.tracking_stages import InitiationOptions as InitiationOptions
    from posefuse.model.options.tracking_stages import LifecycleOptions as LifecycleOptions
    from posefuse.model.options.tracking_stages import PartialDetectionOptions as PartialDetectionOptions
    from posefuse.model.options.tracking_stages import ReidentificationOptions as ReidentificationOptions
    from posefuse.model.options.tracking_stages import ReinitializationOptions as ReinitializationOptions
    from posefuse.model.options.tracking_stages import SharedDetectionOptions as SharedDetectionOptions
    from posefuse.model.options.tracking_stages import SingleViewOptions as SingleViewOptions
    from posefuse.model.options.trajectory import TrajectoryOptions as TrajectoryOptions
    from posefuse.model.options.triangulation import ConsensusOptions as ConsensusOptions
    from posefuse.model.options.triangulation import PercentileFilterOptions as PercentileFilterOptions
    from posefuse.model.options.triangulation import RansacOptions as RansacOptions
    from posefuse.model.options.triangulation import TriangulationOptions as TriangulationOptions
    from posefuse.model.options.triangulation import WeightedSubsetsOptions as WeightedSubsetsOptions
    from posefuse.model.reconstruction import Layer as Layer
    from posefuse.model.reconstruction import Reconstruction as Reconstruction
    from posefuse.model.scene_points import ScenePoints as ScenePoints
    from posefuse.model.status import PointStatus as PointStatus
    from posefuse.model.status import Source as Source
    from posefuse.model.status import ViewStatus as ViewStatus
    from posefuse.model.stored_points import StoredPoints as StoredPoints
    from posefuse.model.tracks import Tracks as Tracks
    from posefuse.model.tracks import TrackState as TrackState
    from posefuse.model.up_axis import InferredUp as InferredUp
    from posefuse.pipeline.calibrate import calibrate as calibrate
    from posefuse.pipeline.calibrate_noise import calibrate_noise as calibrate_noise
    from posefuse.pipeline.calibrate_scene import calibrate_scene as calibrate_scene
    from posefuse.pipeline.calibration_report import write_calibration_report as write_calibration_report
    from posefuse.pipeline.compare_angles import compare_angle_files as compare_angle_files
    from posefuse.pipeline.compare_methods import compare_methods as compare_methods
    from posefuse.pipeline.compare_results import compare_results as compare_results
    from posefuse.pipeline.contact_sheet import write_contact_sheet as write_contact_sheet
    from posefuse.pipeline.detect import detect as detect
    from posefuse.pipeline.diagnose import inspect_health as inspect_health
    from posefuse.pipeline.diagnose import measure_sync as measure_sync
    from posefuse.pipeline.evaluate_files import evaluate_files as evaluate_files
    from posefuse.pipeline.opensim import OpenSimOutcome as OpenSimOutcome
    from posefuse.pipeline.opensim import opensim_results as opensim_results
    from posefuse.pipeline.place_calibration import place_calibration as place_calibration
    from posefuse.pipeline.recalibrate import recalibrate as recalibrate
    from posefuse.pipeline.reconstruct import reconstruct as reconstruct
    from posefuse.pipeline.reconstruct import triangulate as triangulate
    from posefuse.pipeline.reconstruct_recording import Outcome as Outcome
    from posefuse.pipeline.reconstruct_recording import reconstruct_recording as reconstruct_recording
    from posefuse.pipeline.refine_calibration import refine_calibration as refine_calibration
    from posefuse.pipeline.report_videos import write_report as write_report
    from posefuse.pipeline.run.recipe import RunOutcome as RunOutcome
    from posefuse.pipeline.run.recipe import plan_run as plan_run
    from posefuse.pipeline.run.recipe import run as run
    from posefuse.pipeline.start_tag_evidence import start_tag_evidence as start_tag_evidence
    from posefuse.pipeline.sync_evidence import Synchronization as Synchronization
    from posefuse.pipeline.sync_evidence import sound_evidence as sound_evidence
    from posefuse.pipeline.sync_evidence import synchronize as synchronize
    from posefuse.pipeline.sync_recording import SyncRequest as SyncRequest
    from posefuse.pipeline.sync_recording import sync_recording as sync_recording
    from posefuse.pipeline.track_live import Tracker as Tracker
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

_PUBLIC = {
    "biomechanics.center_of_mass": ("center_of_mass", "CentersOfMass"),
    "calibration.boards.calibration": ("BoardCalibration",),
    "calibration.people.result": ("BoardShare", "PeopleCalibration"),
    "calibration.outcome": ("Refinement",),
    "calibration.scene.calibration": ("SceneCalibration",),
    "editing": ("apply_edits",),
    "errors": ("PosefuseError", "PosefuseWarning"),
    "evaluation.accuracy": ("evaluate",),
    "evaluation.angle_agreement": ("compare_angles", "AngleSeries"),
    "evaluation.paired_results": ("people_points", "PeoplePoints"),
    "evaluation.people": ("score_people", "ScoringOptions"),
    "evaluation.self_consistency": ("self_consistency",),
    "io.calibration.read": ("read_cameras",),
    "io.calibration.write": ("write_cameras",),
    "io.checkpoints": ("CheckpointFolder",),
    "io.edits": ("read_edits",),
    "io.keypoints.read": ("read_detections",),
    "io.open_recording": ("RecordingInputs",),
    "io.options": ("read_options",),
    "io.project": ("read_run",),
    "io.results.netcdf": ("read_reconstruction",),
    "io.results.read": ("read_points",),
    "io.results.write": ("write",),
    "model.alignment": ("Alignment",),
    "model.board": ("Board",),
    "model.camera_covariance": ("CameraCovariance", "RigCovariance"),
    "model.cameras": ("Camera", "CameraRig", "LensModel"),
    "model.clock_evidence": ("ClockEvidence",),
    "model.detections": ("Detections",),
    "model.findings": ("Finding",),
    "model.frames": ("Frame",),
    "model.joint_angles": ("AngleStatus", "JointAngles"),
    "model.noise": ("NoiseModel",),
    "model.options.alignment": ("AlignOptions",),
    "model.options.association": ("AssociationOptions", "RptOptions"),
    "model.options.calibration": ("CalibrateOptions", "PeopleOptions"),
    "model.options.detection": ("DetectOptions",),
    "model.options.left_right": ("SideOptions",),
    "model.options.noise": ("NoiseOptions",),
    "model.options.options": ("Options",),
    "model.options.pairs": ("PairOptions", "SdsOptions"),
    "model.options.postprocess": (
        "ButterworthOptions",
        "HampelOptions",
        "KalmanOptions",
        "MedianOptions",
        "OneEuroOptions",
        "PostprocessOptions",
        "SavgolOptions",
    ),
    "model.options.refinement": ("RefineOptions",),
    "model.options.run": ("RunOptions",),
    "model.options.specification": ("SpecificationOptions",),
    "model.options.stream": ("StreamOptions",),
    "model.options.subject": ("SubjectOptions",),
    "model.options.sync": ("SyncOptions",),
    "model.options.tracker": ("TrackerOptions",),
    "model.options.tracking_motion": ("MotionOptions", "PartOptions"),
    "model.options.tracking_stages": (
        "CameraMonitorOptions",
        "FastMotionOptions",
        "IdentityAuditOptions",
        "InitiationOptions",
        "LifecycleOptions",
        "PartialDetectionOptions",
        "ReidentificationOptions",
        "ReinitializationOptions",
        "SharedDetectionOptions",
        "SingleViewOptions",
    ),
    "model.options.trajectory": ("TrajectoryOptions",),
    "model.options.triangulation": (
        "ConsensusOptions",
        "PercentileFilterOptions",
        "RansacOptions",
        "TriangulationOptions",
        "WeightedSubsetsOptions",
    ),
    "model.reconstruction": ("Layer", "Reconstruction"),
    "model.scene_points": ("ScenePoints",),
    "model.status": ("PointStatus", "Source", "ViewStatus"),
    "model.stored_points": ("StoredPoints",),
    "model.tracks": ("Tracks", "TrackState"),
    "model.up_axis": ("InferredUp",),
    "pipeline.calibrate": ("calibrate",),
    "pipeline.calibrate_noise": ("calibrate_noise",),
    "pipeline.calibrate_scene": ("calibrate_scene",),
    "pipeline.calibration_report": ("write_calibration_report",),
    "pipeline.compare_methods": ("compare_methods",),
    "pipeline.detect": ("detect",),
    "pipeline.contact_sheet": ("write_contact_sheet",),
    "pipeline.diagnose": ("inspect_health", "measure_sync"),
    "pipeline.compare_angles": ("compare_angle_files",),
    "pipeline.compare_results": ("compare_results",),
    "pipeline.evaluate_files": ("evaluate_files",),
    "pipeline.opensim": ("opensim_results", "OpenSimOutcome"),
    "pipeline.place_calibration": ("place_calibration",),
    "pipeline.recalibrate": ("recalibrate",),
    "pipeline.reconstruct": ("reconstruct", "triangulate"),
    "pipeline.reconstruct_recording": ("Outcome", "reconstruct_recording"),
    "pipeline.refine_calibration": ("refine_calibration",),
    "pipeline.report_videos": ("write_report",),
    "pipeline.start_tag_evidence": ("start_tag_evidence",),
    "pipeline.sync_evidence": ("sound_evidence", "Synchronization", "synchronize"),
    "pipeline.sync_recording": ("sync_recording", "SyncRequest"),
    "pipeline.run.recipe": ("plan_run", "run", "RunOutcome"),
    "pipeline.track_live": ("Tracker",),
    "preprocess.timeline": ("align_views",),
    "skeleton.skeletons": ("find_skeleton", "Skeleton"),
    "synthetic.crowd_options": ("CrowdFaults", "CrowdOptions"),
    "synthetic.crowds": ("crowd_of_points", "simulate_crowd"),
    "synthetic.options": ("SceneOptions",),
    "synthetic.scenes": ("simulate",),
    "tracking.records": ("People", "Person"),
}
"""Module to its public names."""
_MODULE_OF = {name: module for module, names in _PUBLIC.items() for name in names}

__all__ = [*sorted(_MODULE_OF)]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("posefuse")
    if name in _MODULE_OF:
        return getattr(import_module(f"posefuse.{_MODULE_OF[name]}"), name)
    raise AttributeError(f"module 'posefuse' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*_MODULE_OF, "__version__"])
