"""Choice of the reader of keypoints."""

import pytest

from posefuse import read_detections
from posefuse.errors import FileError


def test_unknown_formats_are_refused(tmp_path):
    with pytest.raises(FileError, match="No keypoints at .*nowhere"):
        read_detections(tmp_path / "nowhere")
    with pytest.raises(FileError, match="no keypoints in a known format. Formats: posefuse"):
        read_detections(tmp_path)
