"""Scores of identities
====================

Compare identities with the truth of a simulation: MOTA, IDF1 and HOTA.
"""

import matplotlib.pyplot as plt

import posefuse

scene = posefuse.simulate_crowd(posefuse.CrowdOptions(people=2, duration_s=3.0, seed=1))
result = posefuse.reconstruct(scene.rig, scene.detections)

scores = posefuse.score_people(posefuse.people_points(result, scene.truth))
print(f"{scores.n_people} people found, {scores.n_true_people} in the truth")
print(f"MOTA {scores.clear[0].mota:.3f}, IDF1 {scores.identity.idf1:.3f}, HOTA {scores.hota.hota:.3f}")
print(f"mean distance of keypoints: {scores.mpjpe_mm:.0f} mm")

worst = sorted(scores.mpjpe_mm_of.items(), key=lambda item: item[1])
figure, axes = plt.subplots()
axes.barh([name for name, _ in worst], [value for _, value in worst])
axes.set(xlabel="mean distance (mm)", title="Error by keypoint")
axes.tick_params(axis="y", labelsize=6)

plt.show()
