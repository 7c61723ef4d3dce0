"""Every kernel is compiled once, whatever the lenses, views and sources of a recording, and warming up compiles all."""

import subprocess
import sys

import pytest

_SIGNATURES = """
import sys
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np

import posefuse
from posefuse.io.calibration import anipose
from posefuse.io.keypoints import native
from posefuse.model.options.options import Options
from posefuse.pipeline.warm_up import TASKS
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from posefuse.synthetic.options import DetectorOptions, SceneOptions
from posefuse.synthetic.scenes import simulate


def signatures():
    numbers = {}
    for name, module in sorted(sys.modules.items()):
        if name.startswith("posefuse.kernels."):
            for function in vars(module).values():
                if isinstance(function, numba.core.dispatcher.Dispatcher) and function.__module__ == name:
                    if function.targetoptions.get("no_cpython_wrapper") is None and function.signatures:
                        numbers[name, function.__name__] = len(function.signatures)
    return numbers
"""

_RECORDINGS = """
swapped = DetectorOptions(swap_share=0.1)
for lens in ("pinhole", "barrel", "fisheye"):
    scene = simulate(SceneOptions(duration_s=1, activities=("walk",), lens=lens, detector=swapped))
    posefuse.reconstruct(scene.rig, scene.detections)
    # Arrays as users make them: writable, and views of other arrays.
    writable = replace(
        scene.detections,
        keypoints_px=np.asfortranarray(scene.detections.keypoints_px),
        confidence=np.array(scene.detections.confidence)[::-1][::-1],
    )
    posefuse.reconstruct(scene.rig, writable, Options(solve="frame"))
    crowd = simulate_crowd(CrowdOptions(people=2, duration_s=1, lens=lens))
    posefuse.reconstruct(crowd.rig, crowd.detections, Options(people="many"))
print({kernel: number for kernel, number in signatures().items() if number > 1})
"""

# Compiled or loaded, a kernel has a signature from its first call on.
_AFTER_WARM_UP = """
for number, task in enumerate(TASKS.values()):
    folder = Path(sys.argv[1]) / str(number)
    folder.mkdir()
    task(folder)
before = signatures()
# The bone lengths become fixed after 4 s, which changes the tempering of the tracks.
for skeleton, duration_s in (("coco_wholebody_133", 2.5), ("coco_17", 6.0)):
    crowd = simulate_crowd(CrowdOptions(people=2, cameras=4, duration_s=duration_s, skeleton=skeleton))
    native.write(crowd.detections, folder / "keypoints.nc")
    anipose.write(crowd.rig, folder / "calibration.toml")
    posefuse.reconstruct_recording(folder, folder / skeleton, Options(people="many"))
after = signatures()
print({kernel: number for kernel, number in after.items() if number > 1 or kernel not in before})
"""


@pytest.mark.parametrize("work", [
    pytest.param(_RECORDINGS, id="recordings"),
    pytest.param(_AFTER_WARM_UP, id="after warming up", marks=pytest.mark.long),
])  # fmt: skip
def test_kernels_have_one_signature(work, tmp_path):
    command = [sys.executable, "-W", "ignore", "-c", _SIGNATURES + work, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "{}\n"
