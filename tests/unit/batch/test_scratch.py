"""Temporary folders of a batch."""

import os
import signal
import subprocess
import sys

import pytest

from posefuse.batch.scratch import require_space, scratch_folder
from posefuse.errors import FileError

HOLD = """
import os, time
from posefuse.batch.scratch import scratch_folder
with scratch_folder() as folder:
    print(folder, flush=True)
    time.sleep(60)
"""


def test_folders_are_removed_also_those_of_killed_processes(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    with subprocess.Popen([sys.executable, "-c", HOLD], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        other = process.stdout.readline().strip()
        with scratch_folder() as first, scratch_folder() as second:
            (first / "file").touch()
            assert first != second
            assert os.path.isdir(other)
        assert not first.exists()
        os.kill(process.pid, signal.SIGKILL)
    assert os.path.isdir(other)
    with scratch_folder():
        assert not os.path.exists(other)


def test_lack_of_space_is_an_error(tmp_path):
    require_space(tmp_path, 1, "s3://bucket/rec")
    with pytest.raises(FileError, match=r"The copy of s3://bucket/rec takes 10{6}\.0 GB.*TMPDIR"):
        require_space(tmp_path, 10**15, "s3://bucket/rec")
