"""The plan of a reconstruction: everything that is determined before the first frame is measured."""

from dataclasses import dataclass

import numpy as np

from posefuse.model.alignment import Alignment
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.findings import Finding
from posefuse.model.layer_scores import LayerScore
from posefuse.model.noise import NoiseModel
from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Layer, Provenance, Reconstruction
from posefuse.model.subjects import Subjects
from posefuse.model.track_events import Event
from posefuse.pipeline.people.tracked_people import TrackedPeople
from posefuse.pipeline.solved_layer import LayerSolver

_KEYPOINTS_PER_JOB = 1e6
"""Number of detected keypoints from which on a further process saves more time than its start takes."""


@dataclass(frozen=True)
class Plan:
    """What a reconstruction needs besides the frames themselves.

    Attributes:
        rig: one camera per view, in the order of the views.
        detections: frames and views to reconstruct.
        requested: options as the user gave them.
        options: the same options with every default resolved for this recording.
        subjects: assigns detections to people.
        bodies: people with fitted bodies, or None.
        noise: noise model of the detections.
        provenance: how the result is made.
        agreement: the sample of points that noise estimation triangulated, or None.
        sample_m: points of a sample of the recording by the chosen method, one array of shape
            (frame, person, keypoint, 3) per range of frames; None where nothing reads them.
        solver: computes the solved layer, or None.
        alignment: similarity to the world of the result, or None to keep the calibration's.
        findings: problems that the recording check found.
        method_notes: those of the provenance's notes that the method's preparation made.
        layer_scores: scores of the layers of the result; empty if there is nothing to compare.
        deviation_sd_m: shape (keypoint,): standard deviations of the keypoints' deviations from bodies, or None.
    """

    rig: CameraRig
    detections: Detections
    requested: Options
    options: Options
    subjects: Subjects
    bodies: TrackedPeople | None
    noise: NoiseModel
    provenance: Provenance
    agreement: Layer | None = None
    sample_m: tuple[np.ndarray, ...] | None = None
    solver: LayerSolver | None = None
    alignment: Alignment | None = None
    findings: tuple[Finding, ...] = ()
    method_notes: tuple[str, ...] = ()
    layer_scores: tuple[LayerScore, ...] = ()
    deviation_sd_m: np.ndarray | None = None

    @property
    def events(self) -> tuple[Event, ...]:
        """Track events of the whole recording."""
        people = self.bodies or self.subjects
        return people.events if isinstance(people, TrackedPeople) else ()


def useful_jobs(detections: Detections) -> int:
    """Return the number of processes beyond which a recording does not profit: one per stretch of some size."""
    per_frame = (
        detections.n_views
        * len(detections.skeleton)
        * max(len(detections.keypoints_px) / max(detections.people_counts.size, 1), 1.0)
    )
    return max(int(detections.n_frames * per_frame / _KEYPOINTS_PER_JOB), 1)


def empty_result(plan: Plan) -> Reconstruction:
    """Return the result of a plan without frames: what all its ranges of frames share."""
    people = plan.subjects.tracks(0, 0).person_ids
    skeleton = plan.detections.skeleton if plan.bodies is None else plan.bodies.skeleton
    points = (0, len(people), len(skeleton))
    views = (*points, len(plan.rig))
    codes = np.empty(points, dtype=np.int8)
    layer = Layer(
        np.empty((*points, 3)), np.empty((*points, 6)), codes, codes, np.empty(points),
        np.empty(views, dtype=np.int8), np.empty(views, dtype=np.float32),
    )  # fmt: skip
    return Reconstruction(
        rig=plan.rig,
        skeleton=skeleton,
        person_ids=people,
        frame_numbers=np.empty(0),
        time_s=np.empty(0),
        layers={"measured": layer},
        noise=plan.noise,
        events=plan.events,
        rate_hz=plan.detections.rate_hz,
        unit="px" if len(plan.rig) == 1 else "m",
        options=plan.requested,
        resolved=plan.options,
        provenance=plan.provenance,
        findings=plan.findings,
        layer_scores=plan.layer_scores,
    )
