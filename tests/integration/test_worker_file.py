"""The worker file of the documentation finds a lamp."""

import numpy as np

from posefuse.detection.open import open_detector
from tests.conftest import ROOT


def test_the_documented_worker_file_works(tmp_path):
    text = (ROOT / "docs" / "detect.md").read_text("utf-8")
    code = text.partition("```python\n")[2].partition("```")[0]
    assert code.count("\n") <= 32
    path = tmp_path / "lamp.py"
    path.write_text(code)
    detector = open_detector(path)
    image = np.zeros((60, 80, 3), dtype=np.uint8)
    image[20:23, 40:45] = 255
    lamp, dark = detector.detect([image, np.zeros_like(image)])
    detector.close()
    assert lamp.keypoints_px.tolist() == [[[42.0, 21.0]]]
    assert lamp.confidence.tolist() == [[1.0]]
    assert len(dark) == 0
    assert detector.skeleton.keypoints == ("lamp",)
