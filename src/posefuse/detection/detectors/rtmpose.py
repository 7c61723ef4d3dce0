"""RTMPose, run by rtmlib with ONNX Runtime."""

from posefuse.detection.registry import DetectorModel, DetectorRecord, Requirements

_PYTHON = (10, 13)

DETECTOR = DetectorRecord(
    name="rtmpose",
    help="Several people; the most accurate one, downloads its weights when it is first used.",
    models=(
        DetectorModel("body26", "halpe_26", "body and feet"),
        DetectorModel("body17", "coco_17", "body"),
        DetectorModel("wholebody133", "coco_wholebody_133", "body, feet, face and hands"),
    ),
    requirements=Requirements(("rtmpose.txt", "onnxruntime.txt"), _PYTHON, 290, 90),
    worker="rtmlib_pose.py",
    licenses="rtmlib Apache-2.0, ONNX Runtime MIT, weights Apache-2.0 (OpenMMLab)",
    weights="About 160 MB of weights are downloaded when it is first used; `weights` names files instead.",
    cuda=Requirements(("rtmpose.txt", "cuda.txt"), _PYTHON, 3000, 1700),
)
