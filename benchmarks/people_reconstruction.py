"""Compare a reconstruction with a calibration from people to one with the laboratory's calibration.

    python -m benchmarks.people_reconstruction FOLDER

FOLDER holds the recordings that the tests read. Printed are the median distance of each camera's detections from the
points of the others, and the root mean square difference of the knee and hip angles.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np

import posefuse
from benchmarks.calibration_recordings import CalibrationCase, recording
from benchmarks.calibration_scores import in_true_world
from benchmarks.held_out import errors_px
from benchmarks.people_calibration import calibrate
from posefuse.biomechanics.tables import angle_table
from posefuse.model.cameras import CameraRig
from posefuse.model.reconstruction import Layer

ANGLES = tuple(f"{side}_{joint}.flexion" for joint in ("knee", "hip") for side in ("left", "right"))


def left_out_px(case: CalibrationCase, rig: CameraRig) -> float:
    """Return the median distance of each camera's detections from the points of the others."""

    def points(others: CameraRig, detections: posefuse.Detections) -> Layer:
        return posefuse.reconstruct(others, detections, posefuse.Options(solve="frame")).layers["measured"]

    return float(np.nanmedian(errors_px(rig, case.detections, points)))


def angles_deg(case: CalibrationCase, rig: CameraRig) -> np.ndarray:
    """Return :data:`ANGLES` by frame, shape (frame, angle)."""
    result = posefuse.reconstruct(rig, case.detections, posefuse.Options(solve="trajectory"))
    names, degrees, _ = angle_table(result)
    return degrees[:, 0][:, [names.index(name) for name in ANGLES]]


def compare(case: CalibrationCase, rig: CameraRig) -> tuple[float, float, np.ndarray]:
    """Return the left-out error of the true rig and of another one, and the differences of the angles, (angle,)."""
    placed = in_true_world(rig, case.rig)
    apart = angles_deg(case, placed) - angles_deg(case, case.rig)
    rms = np.sqrt(np.nanmean(np.square(apart), axis=0))
    return left_out_px(case, case.rig), left_out_px(case, placed), rms


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    case = recording("balancing", given.folder)
    for focal_known in (True, False):
        found = calibrate(case, focal_known=focal_known)
        lab_px, people_px, rms = compare(case, CameraRig(found.estimate.cameras))
        print(f"lenses {'known' if focal_known else 'unknown'}")
        print(
            f"  left-out views: laboratory {lab_px:.2f} px, people {people_px:.2f} px ({people_px / lab_px - 1.0:+.1%})"
        )
        for name, value in zip(ANGLES, rms, strict=True):
            print(f"  {name}: {value:.2f} degrees RMS")


if __name__ == "__main__":
    main()
