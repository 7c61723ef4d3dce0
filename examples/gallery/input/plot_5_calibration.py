"""Refine a calibration
====================

A camera that was bumped is found and corrected from the detections of a person.
"""

from dataclasses import replace

import matplotlib.pyplot as plt

import posefuse

scene = posefuse.simulate(posefuse.SceneOptions(cameras=4, duration_s=6.0, seed=1))

bumped = list(scene.rig.cameras)
moved = bumped[1].camera_from_world.copy()
moved[:3, 3] += 0.03
bumped[1] = replace(bumped[1], camera_from_world=moved)
refined = posefuse.refine_calibration(replace(scene.rig, cameras=tuple(bumped)), scene.detections)
print(f"error in frames left out: {refined.before_px:.1f} px before, {refined.after_px:.1f} px after")

figure, axes = plt.subplots()
axes.bar(["before", "after"], [refined.before_px, refined.after_px])
axes.set(ylabel="median error (px)", title="Error in frames left out")

plt.show()
