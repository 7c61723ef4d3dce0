"""The Python blocks of docs/tutorials/animal-lab.md run on the recording of the page, after its reconstruction."""

import re
import shlex
import shutil
import subprocess
import sys

import pytest

from tests.conftest import ROOT
from tests.integration.test_documents import python_blocks

PAGE = ROOT / "docs" / "tutorials" / "animal-lab.md"


@pytest.mark.long
def test_blocks_run_on_the_recording_of_the_page(shared_data, tmp_path, monkeypatch, capsys):
    recording = shared_data("sleap_mouse")
    for camera in ("back", "mid", "side", "top"):
        shutil.copytree(recording / camera, tmp_path / "mouse" / camera)
    shutil.copy(recording / "calibration_0b26179_good.toml", tmp_path / "mouse" / "calibration.toml")
    text = PAGE.read_text("utf-8")
    (tmp_path / "mouse.toml").write_text(re.findall(r"(?s)```toml\n(.*?)```", text)[0])
    commands = [block.replace("\\\n", " ") for block in re.findall(r"(?s)```sh\n(.*?)```", text)]
    reconstruct = next(command for command in commands if command.startswith("posefuse reconstruct mouse "))
    done = subprocess.run(
        [sys.executable, "-m", *shlex.split(reconstruct)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for block in python_blocks(PAGE):
        exec(compile(block, str(PAGE), "exec"), names)
    printed = capsys.readouterr().out
    assert "measured m" in printed
    assert all(line in text for line in printed.splitlines() if line.startswith(("Nose to", "nose to", "mouse_1")))
