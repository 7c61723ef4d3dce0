"""RTMPose, run by rtmlib with ONNX Runtime."""

from posefuse.detection.registry import DetectorModel, DetectorRecord, Requirements

_PYTHON = (10, 13)
_PEOPLE = "yolox_m_8xb8-300e_humanart-c2c7a14a.zip"
_BODY = "rtmpose-m_simcc-body7_pt-body7"

DETECTOR = DetectorRecord(
    name="rtmpose",
    help="Several people; the most accurate one, downloads its weights when it is first used.",
    models=(
        DetectorModel(
            "body26", "halpe_26", "body and feet", (_PEOPLE, f"{_BODY}-halpe26_700e-256x192-4d3e73dd_20230605.zip")
        ),
        DetectorModel("body17", "coco_17", "body", (_PEOPLE, f"{_BODY}_420e-256x192-e48f03d0_20230504.zip")),
        DetectorModel(
            "wholebody133",
            "coco_wholebody_133",
            "body, feet, face and hands",
            (_PEOPLE, "rtmw-dw-x-l_simcc-cocktail14_270e-256x192_20231122.zip"),
        ),
    ),
    requirements=Requirements(("rtmpose.txt", "onnxruntime.txt"), _PYTHON, 290, 90),
    worker="rtmlib_pose.py",
    licenses="rtmlib Apache-2.0, ONNX Runtime MIT, weights Apache-2.0 (OpenMMLab)",
    weights="About 160 MB of weights are downloaded when it is first used; `weights` names files instead.",
    takes_weights=True,
    cuda=Requirements(("rtmpose.txt", "cuda.txt"), _PYTHON, 3000, 1700),
)
