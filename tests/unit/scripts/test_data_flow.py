"""Detections pass forward from file to file until the measured layer."""

import pytest
from scripts.data_flow import trace_recording


@pytest.mark.long
def test_detections_visit_few_files_and_hardly_return(tmp_path):
    """The only return is that of the choice of the subject, from the file that chooses to its caller."""
    files = trace_recording(tmp_path).files
    assert len(set(files)) <= 13
    assert len(files) - len(set(files)) <= 1
