"""Files of a recording that are not read."""

from posefuse.io.recording import find_recording, ignored_in
from tests.layouts import (
    opencap,
)


def test_files_that_are_not_read_are_listed_with_the_reason(tmp_path):
    opencap(tmp_path)
    for name in ("person.trc", "notes.md", "strange.json", "model.slp"):
        (tmp_path / name).touch()
    reasons = {name: each.reason for each in ignored_in(find_recording(tmp_path)) for name in each.names}
    assert set(reasons) == {"person.trc", "notes.md", "strange.json", "model.slp", "Videos/out.pkl"}
    assert "3D" in reasons["person.trc"]
    assert "pickle" in reasons["Videos/out.pkl"]
    assert "known format" in reasons["strange.json"]


def test_files_that_posefuse_wrote_are_named_as_such(tmp_path):
    opencap(tmp_path)
    for name in ("run.json", "sync.toml", "detection.json", "report.html", "other.json"):
        (tmp_path / name).write_text("{}")
    found = {each.reason: each.names for each in ignored_in(find_recording(tmp_path))}
    own = next(names for reason, names in found.items() if "written by posefuse" in reason)
    assert own == ("detection.json", "report.html", "run.json", "sync.toml")
