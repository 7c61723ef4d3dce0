"""Live tracking
=============

Track people live, one frame at a time, here from a simulated crowd instead of your detectors.
"""

import matplotlib.pyplot as plt
import numpy as np

import posefuse

scene = posefuse.simulate_crowd(posefuse.CrowdOptions(scenario="crowd", people=3, duration_s=4.0, seed=1))
skeleton = scene.detections.skeleton
tracker = posefuse.Tracker(scene.rig, skeleton)


def print_nose(person: posefuse.Person) -> None:
    """Print the position of a person's nose and its standard deviation."""
    nose = skeleton.index("nose")
    x, y, z = person.points_m[nose]
    sd_mm = 1000 * np.sqrt(person.covariance_m2[nose, [0, 3, 5]].sum())
    print(f"         {person.name}: nose at {x:.2f} {y:.2f} {z:.2f} m, standard deviation {sd_mm:.0f} mm")


for number in range(scene.detections.n_frames):
    detected = posefuse.Frame.of(scene.detections, number)
    # Detector output per camera: an array (person, keypoint, 2) and confidences (person, keypoint).
    rows = [detected.view == camera for camera in range(len(scene.rig))]
    keypoints_px, confidence = [detected.keypoints_px[row] for row in rows], [detected.confidence[row] for row in rows]
    frame = posefuse.Frame.of_people(keypoints_px, confidence, time_s=number / 25.0, number=number)

    people = tracker.update(frame)
    for event in people.events:
        print(f"{event.time_s:5.2f} s  {event.person} {event.what}: {event.why}")
    for person in people.people:
        if number % 50 == 49 and person.state == posefuse.TrackState.ACTIVE:
            print_nose(person)

figure, axes = plt.subplots()
for person in people.people:
    axes.plot(person.points_m[:, 0], person.points_m[:, 1], "o", label=person.name)
axes.set(xlabel="x (m)", ylabel="y (m)", title="The last frame from above", aspect="equal")
axes.legend()
plt.show()
