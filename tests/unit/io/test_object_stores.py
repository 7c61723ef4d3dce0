"""Files and folders on object stores."""

import subprocess
import sys

import pytest

import posefuse
from posefuse.errors import FileError, OptionsError, StoreError
from posefuse.io import object_stores
from posefuse.io.object_stores import (
    checked_url,
    download,
    is_url,
    list_entries,
    list_files,
    matching_folders,
    parents_of,
    read_stored,
    remove,
    upload,
    write_stored,
)
from posefuse.model.batch import StoredFile
from tests.object_stores import environment


def test_urls_are_recognized_and_normalized():
    assert is_url("s3://bucket/a")
    assert not any(map(is_url, ("bucket/a", "charuco:7x5,square=30mm", "C:/videos", "tcp:/x")))
    assert parents_of("s3://bucket/a/b") == ["s3://bucket/a", "s3://bucket"]
    pytest.importorskip("s3fs", reason="s3fs is not installed (extra cloud)")
    assert checked_url("S3://bucket/a/") == "s3://bucket/a"
    with pytest.raises(FileError, match="names no bucket"):
        checked_url("s3://")
    with pytest.raises(FileError, match="is no object store that fsspec knows"):
        checked_url("nothing://bucket/a")


def test_a_url_is_no_local_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OptionsError, match="s3://bucket/out is a URL, which only posefuse batch"):
        posefuse.reconstruct_recording("recording", "s3://bucket/out")
    assert not list(tmp_path.iterdir())


def test_files_make_a_round_trip(bucket, tmp_path):
    (tmp_path / "one.txt").write_bytes(b"one")
    (tmp_path / "two.txt").write_bytes(b"two" * 1000)
    upload({f"{bucket}/rec/one.txt": tmp_path / "one.txt", f"{bucket}/rec/sub/two.txt": tmp_path / "two.txt"})
    write_stored(f"{bucket}/rec/three.txt", b"three")
    files = list_files(f"{bucket}/rec")
    assert {name: file.size for name, file in files.items()} == {"one.txt": 3, "sub/two.txt": 3000, "three.txt": 5}
    assert list_files(f"{bucket}/rec/one.txt") == {"": StoredFile(f"{bucket}/rec/one.txt", 3, files["one.txt"].version)}
    assert list_files(f"{bucket}/nothing") == {}
    folders, entries = list_entries(f"{bucket}/rec")
    assert (folders, [file.url for file in entries]) == (["sub"], [f"{bucket}/rec/one.txt", f"{bucket}/rec/three.txt"])
    assert list_entries(f"{bucket}/nothing") == ([], [])
    download({tmp_path / "copy" / name: file for name, file in files.items()})
    assert (tmp_path / "copy" / "sub" / "two.txt").read_bytes() == b"two" * 1000
    write_stored(f"{bucket}/rec/three.txt", b"3")
    assert list_files(f"{bucket}/rec")["three.txt"].version != files["three.txt"].version
    with pytest.raises(StoreError, match="changed while it was downloaded") as caught:
        download({tmp_path / "copy" / "three.txt": files["three.txt"]})
    assert caught.value.transient
    remove([f"{bucket}/rec/one.txt", f"{bucket}/rec/absent.txt"])
    assert read_stored(f"{bucket}/rec/one.txt") is None
    assert read_stored(f"{bucket}/rec/three.txt") == b"3"


def test_patterns_match_folders(bucket):
    for name in ("day_1/walk_1", "day_1/walk_2", "day_2/walk_1", "day_2/run_1"):
        write_stored(f"{bucket}/{name}/keypoints.nc", b"x")
    assert matching_folders(f"{bucket}/day_*/walk_*") == [
        f"{bucket}/day_1/walk_1", f"{bucket}/day_1/walk_2", f"{bucket}/day_2/walk_1",
    ]  # fmt: skip
    with pytest.raises(FileError, match="No folder matches"):
        matching_folders(f"{bucket}/month_*")


def test_errors_say_what_to_do(s3, bucket, tmp_path):
    for call in (lambda url: list_files(url), lambda url: list_entries(url), lambda url: write_stored(url, b"")):
        with pytest.raises(StoreError, match="There is no bucket s3://no-such-bucket") as caught:
            call("s3://no-such-bucket/rec")
        assert not caught.value.transient
    code = (
        "from posefuse.errors import StoreError\nfrom posefuse.io.object_stores import list_files\n"
        f"try: list_files({bucket + '/rec'!r})\nexcept StoreError as error: print(error.transient, error)"
    )

    def told() -> str:
        return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout

    nowhere = str(tmp_path / "nowhere")
    with environment(
        AWS_ACCESS_KEY_ID="", AWS_SECRET_ACCESS_KEY="", AWS_SHARED_CREDENTIALS_FILE=nowhere, AWS_CONFIG_FILE=nowhere,
        AWS_EC2_METADATA_DISABLED="true",
    ):  # fmt: skip
        answer = told()
    assert answer.startswith(f"False No credentials for {bucket}:")
    assert "aws configure" in answer
    with environment(AWS_ENDPOINT_URL="http://127.0.0.1:9", AWS_MAX_ATTEMPTS="1"):
        answer = told()
    assert answer.startswith(f"True {bucket} does not answer as expected")
    assert "AWS_ENDPOINT_URL" in answer


def test_missing_extra_is_named(monkeypatch):
    monkeypatch.setattr(object_stores.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(FileError, match=r"s3://bucket/a needs fsspec.*pip install 'posefuse\[cloud\]'"):
        checked_url("s3://bucket/a")


def test_missing_library_of_a_store_is_named(monkeypatch):
    fsspec = pytest.importorskip("fsspec", reason="fsspec is not installed (extra cloud)")

    def absent(_: str) -> None:
        raise ImportError("Install s3fs to access S3")

    monkeypatch.setattr(fsspec, "filesystem", absent)
    with pytest.raises(FileError, match=r"Install s3fs.*pip install 'posefuse\[cloud\]'"):
        checked_url("s3://bucket/a")


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (PermissionError("Access Denied"), "gs://b denies access: Access Denied. The credentials must allow"),
        (OSError("Anonymous caller does not have storage.objects.list"), "No credentials for gs://b.*gcloud auth"),
        (TimeoutError(), "gs://b does not answer as expected: TimeoutError"),
    ],
)
def test_errors_of_other_stores_are_explained(error, message):
    with pytest.raises(StoreError, match=message), object_stores._explained("gs://b/rec"):
        raise error
