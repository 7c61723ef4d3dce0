"""Joint angles of Pose2Sim: triangulation, filter, and inverse kinematics with OpenSim; prints its figures as JSON.

``run.py FOLDER [--rate HZ] [--height M]``. FOLDER is a project with ``calibration/Calib.toml`` and, in ``pose``, one
folder of OpenPose files per camera, with the keypoints of halpe_26. The options are those of the configuration that
Pose2Sim comes with, without the neural network that adds markers. Angles go to ``angles.mot``.
"""

import argparse
import contextlib
import json
import os
import shutil
import sys
import time
from pathlib import Path

import rtoml
from Pose2Sim import Pose2Sim


def main() -> None:
    """Run the three stages, and print their CPU time."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rate", type=float, default=60.0)
    parser.add_argument("--height", type=float, default=1.75)
    given = parser.parse_args()
    config = rtoml.load(Path(Pose2Sim.__file__).parent / "Demo_SinglePerson" / "Config.toml")
    config["project"] |= {
        "project_dir": str(given.folder), "frame_rate": int(given.rate), "frame_range": "all",
        "participant_height": given.height,
    }  # fmt: skip
    config["filtering"] |= {"display_figures": False, "save_filt_plots": False, "make_c3d": False}
    config["triangulation"]["make_c3d"] = False
    config["kinematics"] |= {"use_augmentation": False, "default_height": given.height}
    (given.folder / "Config.toml").write_text(rtoml.dumps(config))
    os.chdir(given.folder)
    start = time.process_time()
    # Its messages would mix with the figures.
    with contextlib.redirect_stdout(sys.stderr):
        Pose2Sim.triangulation(config)
        Pose2Sim.filtering(config)
        Pose2Sim.kinematics(config)
    spent = time.process_time() - start
    (found,) = (given.folder / "kinematics").glob("*.mot")
    shutil.copyfile(found, given.folder / "angles.mot")
    print(json.dumps({"cpu_s": spent}))


if __name__ == "__main__":
    main()
