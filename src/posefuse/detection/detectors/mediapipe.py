"""MediaPipe, whose wheel contains its models."""

from posefuse.detection.registry import DetectorModel, DetectorRecord, Requirements

DETECTOR = DetectorRecord(
    name="mediapipe",
    help="One person, or several; fast on a CPU, needs no download of weights.",
    models=(
        DetectorModel("pose", "mediapipe_33", "33 keypoints of the body"),
        DetectorModel("people", "mediapipe_33", "several people, in eight times the time"),
        DetectorModel("holistic", "mediapipe_holistic_543", "body, hands and the mesh of the face"),
    ),
    requirements=Requirements(("mediapipe.txt",), (9, 12), 300, 110),
    worker="mediapipe_landmarks.py",
    licenses="Apache-2.0, code and models",
    weights="The package contains the models.",
)
