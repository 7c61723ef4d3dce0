"""Every kernel is compiled once, whatever the lenses, views and sources of a recording."""

import subprocess
import sys

_RECORDINGS = """
import sys
from dataclasses import replace

import numba
import numpy as np

import posefuse
from posefuse.model.options.options import Options
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from posefuse.synthetic.options import DetectorOptions, SceneOptions
from posefuse.synthetic.scenes import simulate

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
for name, module in sorted(sys.modules.items()):
    if name.startswith("posefuse.kernels."):
        for function in vars(module).values():
            if isinstance(function, numba.core.dispatcher.Dispatcher) and function.__module__ == name:
                if function.targetoptions.get("no_cpython_wrapper") is None and len(function.signatures) > 1:
                    print(name, function.__name__, len(function.signatures))
"""


def test_kernels_have_one_signature():
    done = subprocess.run([sys.executable, "-c", _RECORDINGS], capture_output=True, text=True, check=True)
    assert done.stdout == ""
