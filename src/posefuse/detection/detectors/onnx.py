"""Any ONNX model that a TOML file describes."""

from posefuse.detection.registry import DetectorModel, DetectorRecord, Requirements

_PYTHON = (10, 13)

DETECTOR = DetectorRecord(
    name="onnx",
    help="Your own ONNX model, described by a TOML file.",
    models=(DetectorModel("", "", "as described by the TOML file"),),
    requirements=Requirements(("onnx.txt", "onnxruntime.txt"), _PYTHON, 280, 85),
    worker="onnx_model.py",
    licenses="ONNX Runtime MIT; the license of your model",
    weights="The TOML file names the model.",
    cuda=Requirements(("onnx.txt", "cuda.txt"), _PYTHON, 3000, 1700),
)
