"""The answer of all commands to a folder that has videos only."""

import pytest

from posefuse.io.videos_only import videos_only
from tests.integration.conftest import run  # noqa: F401
from tests.videos import coded_video


@pytest.fixture
def videos(tmp_path, monkeypatch):
    monkeypatch.setenv("POSEFUSE_HOME", str(tmp_path / "home"))
    (tmp_path / "take").mkdir()
    for name in ("a", "b"):
        coded_video(tmp_path / "take" / f"{name}.mp4", 2)
    return tmp_path / "take"


def test_what_is_missing_is_named(videos, tmp_path, monkeypatch):
    assert videos_only(videos).endswith(
        f"posefuse run {videos} `output='OUT'`, after posefuse detector install mediapipe."
    )
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert "after pip install 'posefuse[video]' and posefuse detector install mediapipe." in videos_only(videos)
    assert videos_only(tmp_path / "home") is None


@pytest.mark.parametrize(
    ("command", "more"),
    [
        ("reconstruct", ["--output", "out"]),
        ("inspect", []),
        ("sync", ["--output", "out.toml"]),
        ("calibrate", ["--output", "out.toml"]),
        ("refine-calibration", ["--output", "out.toml"]),
        ("calibrate-noise", ["--output", "out.toml"]),
        ("compare", ["--output", "out"]),
    ],
)
def test_every_command_names_run(run, videos, command, more, monkeypatch, tmp_path):  # noqa: F811
    monkeypatch.chdir(tmp_path)
    code, _, err = run(command, videos, *more)
    assert code == 1
    assert "posefuse run" in err
    assert "posefuse detector install mediapipe" in err
