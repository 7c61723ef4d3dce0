"""Fingerprints of results."""

import pytest

from posefuse.errors import FileError, OutputExistsError
from posefuse.io.checkpoints import CheckpointFolder
from posefuse.model.options.options import Options
from posefuse.model.options.subject import SubjectOptions
from posefuse.pipeline.fingerprints import RecordingKeys, find_earlier, read_mark, recording_keys, write_mark

INPUTS = {"keypoints.nc": "1"}


@pytest.fixture
def folder(tmp_path):
    for name in ("reconstruction.nc", "report.html"):
        (tmp_path / name).write_text(name)
    return tmp_path


def test_result_is_found_until_something_changes(folder, tmp_path_factory):
    keys = recording_keys(INPUTS, Options())
    with pytest.raises(OutputExistsError, match="a result .reconstruction.nc, report.html. of other inputs"):
        find_earlier(folder, [keys])
    write_mark(folder, keys.result, ["reconstruction.nc", "report.html"], {"statistics": 1})
    mark = find_earlier(folder, [keys])
    assert mark is not None
    assert mark == read_mark(folder)
    assert (mark.files, mark.remembered) == (("reconstruction.nc", "report.html"), {"statistics": 1})
    own = tmp_path_factory.mktemp("skeleton") / "own.toml"
    own.write_text("1")
    others = [
        recording_keys({"keypoints.nc": "2"}, Options()),
        recording_keys(INPUTS, Options(people="many")),
        recording_keys(INPUTS, Options(skeleton=str(own))),
        recording_keys(INPUTS, Options(), edits=own),
        recording_keys(INPUTS, Options(), also=("npz",)),
        recording_keys(INPUTS, Options(), window_s=10.0),
    ]
    assert len({each.result for each in (keys, *others)}) == 7
    with pytest.raises(OutputExistsError, match="other inputs, options or versions"):
        find_earlier(folder, others)
    assert find_earlier(folder, [*others, keys]) == mark


def test_incomplete_results_are_repeated_and_changed_ones_are_not(folder):
    keys = recording_keys(INPUTS, Options())
    write_mark(folder, keys.result, ["reconstruction.nc", "report.html"], {})
    (folder / "report.html").unlink()
    assert find_earlier(folder, [keys]) is None
    (folder / "report.html").write_text("page")
    (folder / "reconstruction.nc").write_text("another result")
    with pytest.raises(OutputExistsError):
        find_earlier(folder, [keys])
    (folder / "reconstruction.nc").unlink()
    assert find_earlier(folder, [keys]) is None
    (folder / "fingerprint.json").write_text("{}")
    with pytest.raises(FileError, match="already contains other files"):
        find_earlier(folder, [keys])


def test_only_the_own_checkpoint_resumes(tmp_path):
    keys, others = recording_keys(INPUTS, Options()), recording_keys(INPUTS, Options(people="many"))
    CheckpointFolder(tmp_path / ".parts", keys.parts).save("measured", 1)
    assert find_earlier(tmp_path, [keys]) is None
    assert find_earlier(tmp_path, [recording_keys(INPUTS, Options(), also=("npz",))]) is None
    with pytest.raises(OutputExistsError, match="an unfinished reconstruction of other inputs"):
        find_earlier(tmp_path, [others])


def test_run_killed_before_its_first_part_is_repeated(tmp_path):
    (tmp_path / ".parts" / "tracking").mkdir(parents=True)
    (tmp_path / ".parts" / "manifest.json.partial").write_text("{")
    assert find_earlier(tmp_path, [recording_keys(INPUTS, Options())]) is None
    (tmp_path / ".parts" / "thesis.txt").write_text("text")
    with pytest.raises(FileError, match="files that are not parts"):
        find_earlier(tmp_path, [recording_keys(INPUTS, Options())])


def test_path_of_a_skeleton_does_not_count(tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.toml").write_text("same")
    first, second = (recording_keys(INPUTS, Options(skeleton=str(tmp_path / f"{name}.toml"))) for name in "ab")
    assert first == second


def test_a_static_trial_counts_by_its_content(tmp_path):
    def keys(name: str) -> RecordingKeys:
        return recording_keys(INPUTS, Options(subject=SubjectOptions(static=name)))

    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "reconstruction.nc").write_text("standing")
    first = keys(str(tmp_path / "a"))
    assert keys(str(tmp_path / "b")) == first
    assert keys(str(tmp_path / "a" / "reconstruction.nc")) == first
    # A report that is written again does not change the trial.
    (tmp_path / "a" / "report.html").write_text("page")
    assert keys(str(tmp_path / "a")) == first
    (tmp_path / "a" / "reconstruction.nc").write_text("leaning")
    assert keys(str(tmp_path / "a")).result != first.result
    assert len({each.result for each in (first, keys("0:60"), keys("0:50"), recording_keys(INPUTS, Options()))}) == 4
