"""Score calibrations from people on recordings with known cameras.

    python -m benchmarks.people_calibration FOLDER [--keypoints FOLDER] [--only NAME ...] [--unknown-focal]

FOLDER holds the recordings that the tests read, ``--keypoints`` the keypoints that ``benchmarks/peers/mediapipe``
detects in videos. Printed are the median relative rotation of two cameras (maximum), the median error of a camera
center after the similarity that fits the other cameras (maximum), the scale, the focal length, and the time offset.
``--start truth`` starts the final estimate near the truth, with true identities; ``--stage start`` scores the
approximate calibration from which the final estimate starts.
"""

import argparse
import os
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from benchmarks.calibration_recordings import RECORDINGS, CalibrationCase, recording, staggered
from benchmarks.calibration_scores import CalibrationScore, score_calibration
from posefuse.calibration.people.estimate import PeopleEstimate, estimate_people
from posefuse.calibration.people.match import match_views
from posefuse.calibration.people.tracks import tracks_in_views
from posefuse.calibration.people.views import MatchedViews, ViewTracks
from posefuse.errors import PosefuseError
from posefuse.model.cameras import Camera, rotation_from_vector

Start = Literal["people", "truth"]
Stage = Literal["start", "estimate"]
KEYPOINTS = "POSEFUSE_BENCHMARK_KEYPOINTS"
"""Environment variable with the default of ``--keypoints``."""
VIDEOS = "balancing_mediapipe"
_TURN_DEG, _SHIFT_M, _LATE_S, _FOCAL = 3.0, 0.3, 0.1, 0.1


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A calibration of a recording.

    Attributes:
        matched: views and approximate calibration.
        estimate: final estimate.
        cpu_s: CPU time.
    """

    matched: MatchedViews
    estimate: PeopleEstimate
    cpu_s: float

    def score(self, case: CalibrationCase, stage: Stage = "estimate") -> CalibrationScore:
        """Score the estimate, or the approximate calibration."""
        if stage == "start":
            cameras, offset_s = tuple(view.camera for view in self.matched.views), self.matched.offset_s
        else:
            cameras, offset_s = self.estimate.cameras, self.estimate.offset_s
        return score_calibration(
            cameras, case.rig, offset_s=offset_s, true_offset_s=case.offset_s, rate_hz=case.rate_hz
        )


def calibrate(case: CalibrationCase, *, focal_known: bool = True, start: Start = "people", seed: int = 0) -> Calibrated:
    """Calibrate a recording from its people.

    Args:
        case: the recording.
        focal_known: whether the lenses are given; otherwise, only the sizes of the images are.
        start: start of the final estimate: from the people alone, or near the truth.
        seed: random seed.
    """
    begun = time.process_time()
    if start == "truth":
        matched = true_start(case, np.random.default_rng(seed), focal_known=focal_known)
    else:
        lenses = case.lenses(focal_known=focal_known).cameras
        matched = match_views(tracks_in_views(case.detections, lenses, focal_known), seed)
    found = estimate_people(matched)
    return Calibrated(matched, found, time.process_time() - begun)


def true_start(case: CalibrationCase, rng: np.random.Generator, *, focal_known: bool = True) -> MatchedViews:
    """Return the start near the truth: disturbed poses, clocks and focal lengths, and true identities.

    Views must show one person, or the true person of each detection must be known.

    Args:
        case: the recording.
        rng: random generator.
        focal_known: whether focal lengths are known.
    """
    lenses = case.lenses(focal_known=focal_known)
    views = []
    for v, (lens, camera) in enumerate(zip(lenses.cameras, case.rig.cameras, strict=True)):
        pose = np.eye(4)
        turn = np.radians(_TURN_DEG) * rng.standard_normal(3) / np.sqrt(3.0)
        pose[:3, :3] = rotation_from_vector(turn) @ camera.rotation
        pose[:3, 3] = -pose[:3, :3] @ (camera.center_m + _SHIFT_M * rng.standard_normal(3) / np.sqrt(3.0))
        matrix = lens.matrix.copy()
        if not focal_known:
            matrix[[0, 1], [0, 1]] = camera.matrix[0, 0] * np.exp(_FOCAL * rng.standard_normal())
        views.append(_tracks(case, v, replace(lens, camera_from_world=pose, matrix=matrix), focal_known))
    late = case.offset_s + np.where(np.ptp(case.offset_s) > 0.0, _LATE_S, 0.0) * rng.standard_normal(len(views))
    return MatchedViews(case.detections.skeleton, tuple(views), late - late[0], np.ones(len(views)), {})


def _tracks(case: CalibrationCase, view: int, camera: Camera, focal_known: bool) -> ViewTracks:
    """Return the keypoints of one view by true person."""
    every = case.detections
    person = np.zeros(len(every.track_ids), dtype=int) if case.person is None else case.person
    cell = np.repeat(np.arange(every.n_frames * every.n_views), every.people_counts.ravel())
    mine = (cell % every.n_views == view) & (person >= 0)
    rows = (cell[mine] // every.n_views, person[mine])
    shape = (every.n_frames, int(person.max(initial=0)) + 1, len(every.skeleton))
    pixels, confidence = np.full((*shape, 2), np.nan), np.full(shape, np.nan)
    pixels[rows], confidence[rows] = every.keypoints_px[mine], every.confidence[mine]
    if not np.isfinite(confidence).any():
        confidence = np.where(np.isfinite(pixels[..., 0]), 1.0, np.nan)
    has = np.isfinite(every.time_s[:, view])
    return ViewTracks(camera, focal_known, every.time_s[has, view], pixels[has], confidence[has])


TARGETS = {
    "balancing": (0.8, 60.0),
    "balancing_mediapipe": (2.0, 120.0),
    "two_people": (1.5, float("nan")),
    "webcams": (1.5, float("nan")),
    "panoptic": (0.3, 15.0),
    "mvor": (3.0, float("nan")),
}
"""Largest median errors that are aimed at with known lenses: relative rotation in degrees and centers in mm."""
COLUMNS = ("recording", "lenses", "cameras", "rotation, degrees", "centers, mm", "scale", "focal, %", "offset, frames")


def row(case: CalibrationCase, calibrated: Calibrated, *, focal_known: bool, stage: Stage) -> str:
    """Return the row of the table of a recording."""
    left_out = "".join(f", without {name}" for name in calibrated.matched.left_out)
    s = calibrated.score(case, stage)
    return table_row(case.name, "known" if focal_known else "unknown", f"{s.cameras}{left_out}", s, calibrated.cpu_s)


def table_row(name: str, lenses: str, cameras: str, score: CalibrationScore, cpu_s: float) -> str:
    """Return a row: median errors, and the largest ones in parentheses."""
    s = score
    pairs = (
        f"{s.rotation_deg:.2f} ({s.worst_rotation_deg:.2f})",
        f"{1000 * s.center_m:.0f} ({1000 * s.worst_center_m:.0f})",
        f"{s.scale:.3f}",
        f"{100 * s.focal:.1f} ({100 * s.worst_focal:.1f})",
        f"{s.offset_frames:.2f} ({s.worst_offset_frames:.2f})",
    )
    return f"| {name} | {lenses} | {cameras} | {' | '.join(pairs)} | {cpu_s:.1f} |"


def staggers(case: CalibrationCase) -> np.ndarray:
    """Return start times of the views, up to 2 s apart or a fifth of the recording."""
    span = case.detections.n_frames / float(case.rate_hz[0])
    return np.linspace(0.0, 1.0, len(case.rig))[np.arange(len(case.rig)) * 3 % len(case.rig)] * min(2.0, span / 5.0)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--keypoints", type=Path, default=os.environ.get(KEYPOINTS))
    parser.add_argument("--only", nargs="*", default=[*RECORDINGS, VIDEOS], choices=[*RECORDINGS, VIDEOS])
    parser.add_argument("--unknown-focal", action="store_true", help="estimate focal lengths")
    parser.add_argument("--staggered", action="store_true", help="views start up to 2 s apart")
    parser.add_argument("--start", choices=get_args(Start), default="people")
    parser.add_argument("--stage", choices=get_args(Stage), default="estimate")
    given = parser.parse_args()
    print(f"| {' | '.join(COLUMNS)} | CPU s |\n" + "|---" * (len(COLUMNS) + 1) + "|")
    for name in given.only:
        if name == VIDEOS and given.keypoints is None:
            print(f"| {name} | needs the keypoints of its videos |||||||||")
            continue
        case = recording(name, given.folder, given.keypoints)
        if given.staggered:
            case = staggered(case, staggers(case))
        try:
            found = calibrate(case, focal_known=not given.unknown_focal, start=given.start)
        except PosefuseError as error:
            print(f"| {case.name} | {error} |||||||||", flush=True)
            continue
        print(row(case, found, focal_known=not given.unknown_focal, stage=given.stage), flush=True)


if __name__ == "__main__":
    main()
