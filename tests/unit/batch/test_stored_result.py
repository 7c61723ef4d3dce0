"""Results on an object store and their marks."""

import json

import pytest

from posefuse.batch import stored_result
from posefuse.batch.stored_result import StoredResult, is_complete, read_upload_mark
from posefuse.errors import FileError
from posefuse.io.files import CHECKPOINT_FOLDER
from posefuse.io.object_stores import list_files, read_stored, upload, write_stored
from posefuse.model.batch import JobResult, ResultStatistics
from tests.object_stores import contents

DONE = JobResult("rec", "done", statistics=ResultStatistics(6, 0.2, 3, 1, 1.0, None, None, None), warnings=("careful",))


@pytest.fixture
def url(bucket):
    return f"{bucket}/out/rec"


def opened(url, folder, key="key", places=None) -> StoredResult:
    folder.mkdir(parents=True, exist_ok=True)
    return StoredResult(url, folder, key, places or {})


def finished(url, folder, key="key", **files: str) -> StoredResult:
    """Upload a result with some files."""
    stored = opened(url, folder, key)
    assert stored.examine() is None
    stored.fetch()
    for name, text in files.items():
        (folder / name).write_text(text)
    stored.finish(DONE)
    return stored


def test_complete_result_is_recognized_until_something_changes(url, tmp_path):
    finished(url, tmp_path / "a", one="1", two="2")
    assert is_complete(url)
    earlier = opened(url, tmp_path / "b").examine()
    assert earlier is not None
    assert (earlier.state, earlier.statistics, earlier.warnings) == ("kept", DONE.statistics, DONE.warnings)
    assert opened(url, tmp_path / "b", key="other").examine() is None
    write_stored(f"{url}/one", b"!")
    assert opened(url, tmp_path / "b").examine() is None


def test_files_of_an_earlier_result_are_replaced_and_others_stay(url, tmp_path):
    finished(url, tmp_path / "a", one="1", two="2")
    write_stored(f"{url}/notes.txt", b"mine")
    stored = opened(url, tmp_path / "b", key="other")
    assert stored.examine() is None
    (tmp_path / "b" / "two").write_text("22")
    stored.finish(DONE)
    assert contents(url) == {"two": b"22", "notes.txt": b"mine"}


def test_another_worker_continues_from_the_finished_stages(url, tmp_path):
    first = opened(url, tmp_path / "a")
    assert first.examine() is None
    (tmp_path / "a" / "stage").mkdir()
    (tmp_path / "a" / "stage" / "one").write_text("1")
    (tmp_path / "a" / ".two.partial.csv").write_text("half")
    first.upload_changes()
    assert not is_complete(url)
    # A later stage was being uploaded when the worker died.
    write_stored(f"{url}/two", b"of another moment")
    write_stored(f"{url}/{CHECKPOINT_FOLDER}/solved_00001.part", b"part")
    second = opened(url, tmp_path / "b")
    assert second.examine() is None
    second.fetch()
    found = sorted(
        path.relative_to(tmp_path / "b").as_posix() for path in (tmp_path / "b").rglob("*") if path.is_file()
    )
    assert found == [f"{CHECKPOINT_FOLDER}/solved_00001.part", "stage/one"]
    (tmp_path / "b" / CHECKPOINT_FOLDER / "solved_00001.part").unlink()
    second.finish(DONE)
    assert set(contents(url)) == {"stage/one", "two"}


def test_a_result_that_is_being_replaced_is_not_complete(url, tmp_path):
    finished(url, tmp_path / "a", one="1", two="2")
    stored = opened(url, tmp_path / "b", key="other")
    assert stored.examine() is None
    stored.fetch()
    (tmp_path / "b" / "one").write_text("11")
    stored.upload_changes()
    mark = read_upload_mark(url)
    assert mark is not None
    assert (mark.state, set(mark.files)) == ("running", {"one", "two"})


def test_interrupted_upload_is_repeated(url, tmp_path, monkeypatch):
    """The process dies when one of two files is on the store."""

    def half(files) -> None:
        upload(dict(list(files.items())[:1]))
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(stored_result, "upload", half)
        with pytest.raises(KeyboardInterrupt):
            finished(url, tmp_path / "a", one="1", two="2")
    assert set(contents(url)) == {"one"}
    assert not is_complete(url)
    # The next attempt makes other files, such as those of fewer people.
    finished(url, tmp_path / "b", key="other", two="2")
    assert contents(url) == {"two": b"2"}


def test_folder_with_other_files_is_refused(url, tmp_path):
    write_stored(f"{url}/thesis.txt", b"text")
    with pytest.raises(FileError, match=r"already contains other files \(thesis.txt\)"):
        opened(url, tmp_path / "a").examine()
    write_stored(f"{url}/upload.json", b"{")
    assert opened(url, tmp_path / "a").examine() is None


def test_project_file_names_urls(url, tmp_path):
    stored = opened(url, tmp_path / "out", places={tmp_path / "in": "s3:/"})
    (tmp_path / "out" / "posefuse.toml").write_text(f'board_images = "{tmp_path}/in/bucket/calibration"\n')
    stored.finish(DONE)
    assert read_stored(f"{url}/posefuse.toml") == b'board_images = "s3://bucket/calibration"\n'
    assert json.loads(read_stored(f"{url}/upload.json") or b"")["state"] == "complete"


def double(piece) -> None:
    """Process a piece as distributed work does: the result lies beside it."""
    piece.with_suffix(".part").write_bytes(2 * piece.read_bytes())


def test_pieces_are_processed_by_workers_without_a_shared_folder(url, tmp_path):
    stored = opened(url, tmp_path / "out")
    pieces = [tmp_path / "out" / ".parts" / f"piece_{i}.todo" for i in range(2)]
    for piece in pieces:
        piece.parent.mkdir(exist_ok=True)
        piece.write_text(piece.stem)
    stored.run_elsewhere(lambda task, urls: [task(each) for each in urls] and None, double, pieces)
    assert (tmp_path / "out" / ".parts" / "piece_1.part").read_text() == "piece_1piece_1"
    assert f"{url}/.parts/piece_1.part" in {file.url for file in list_files(url).values()}
