"""Detections pass forward from file to file until the measured layer."""

import pytest
from scripts.data_flow import trace_recording


@pytest.mark.long
def test_detections_visit_few_files_and_return_to_none(tmp_path):
    files = trace_recording(tmp_path).files
    assert len(set(files)) <= 9
    assert len(files) == len(set(files))
