"""Compare a reconstruction with a calibration from people to one with the laboratory's calibration.

    python -m benchmarks.people_reconstruction FOLDER

FOLDER holds the recordings that the tests read. Printed are the median distance of each camera's detections from the
points of the others, and the root mean square difference of the knee and hip angles: from the laboratory's calibration,
and from that calibration refined on the same detections, which shows how well the reference itself is known.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np

import posefuse
from benchmarks.calibration_recordings import CalibrationCase, recording
from benchmarks.calibration_scores import in_true_world
from benchmarks.held_out import Points, errors_px, layer_of, people_of
from benchmarks.held_out_recordings import Case
from benchmarks.people_calibration import calibrate
from posefuse.biomechanics.tables import keypoint_angles
from posefuse.model.cameras import CameraRig

ANGLES = tuple(f"{side}_{joint}.flexion" for joint in ("knee", "hip") for side in ("left", "right"))


def left_out_px(case: CalibrationCase, rig: CameraRig) -> float:
    """Return the median distance of each camera's detections from the points of the others."""

    def points(part: Case) -> Points:
        result = posefuse.reconstruct(part.rig, part.detections, posefuse.Options(solve="frame"))
        return {"measured": layer_of(result, "measured")}

    recording = Case(rig, case.detections)
    return float(np.nanmedian(errors_px(recording, people_of(recording), points)["measured"]))


def angles_deg(case: CalibrationCase, rig: CameraRig) -> np.ndarray:
    """Return :data:`ANGLES` by frame, shape (frame, angle)."""
    result = posefuse.reconstruct(rig, case.detections, posefuse.Options(solve="trajectory"))
    names, degrees, _ = keypoint_angles(result)
    return degrees[:, 0][:, [names.index(name) for name in ANGLES]]


def _listed(apart_deg: np.ndarray) -> str:
    """Return the root mean square of differences of the angles, as text."""
    rms = np.sqrt(np.nanmean(np.square(apart_deg), axis=0))
    return ", ".join(f"{name} {value:.2f}" for name, value in zip(ANGLES, rms, strict=True)) + " degrees RMS"


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    case = recording("balancing", given.folder)
    refined = posefuse.refine_calibration(case.rig, case.detections).rig
    references = {
        "laboratory": angles_deg(case, case.rig),
        "refined": angles_deg(case, in_true_world(refined, case.rig)),
    }
    print("angles, refined - laboratory:", _listed(references["refined"] - references["laboratory"]))
    for focal_known in (True, False):
        found = calibrate(case, focal_known=focal_known)
        placed = in_true_world(CameraRig(found.estimate.cameras), case.rig)
        lab_px, people_px = left_out_px(case, case.rig), left_out_px(case, placed)
        angles = angles_deg(case, placed)
        print(f"lenses {'known' if focal_known else 'unknown'}")
        print(
            f"  left-out views: laboratory {lab_px:.2f} px, people {people_px:.2f} px ({people_px / lab_px - 1.0:+.1%})"
        )
        for name, reference in references.items():
            print(f"  angles, people - {name}:", _listed(angles - reference))


if __name__ == "__main__":
    main()
