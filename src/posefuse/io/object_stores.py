"""Folders on object stores such as S3 and Google Cloud Storage, by URL, through fsspec (extra ``cloud``).

This is the only module that imports fsspec, and it does so when a URL is used.
"""

import contextlib
import importlib.util
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any, TypeGuard

from posefuse.errors import FileError, OptionsError, StoreError, choices
from posefuse.model.batch import StoredFile

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")
_INSTALL = "Install it: pip install 'posefuse[cloud]'."
_VERSIONS = ("ETag", "md5Hash", "crc32c", "etag", "content_md5", "mtime", "created")
"""Entries of a listing that change with the content of a file, one of which each store has."""
_CREDENTIALS = {
    "s3": "Set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or run aws configure; on a cluster, for every worker",
    "gs": "Run gcloud auth application-default login, or set GOOGLE_APPLICATION_CREDENTIALS; on a cluster, for every "
    "worker",
}
_NO_CREDENTIALS = ("Credential", "ProfileNotFound", "RefreshError", "TokenRetrieval")
"""Parts of the names of exceptions that the libraries of stores raise without usable credentials."""
_ANONYMOUS = ("anonymous caller", "unable to locate credentials")
_INVALID = ("not valid", "invalid bucket", "invalidbucketname")


def is_url(place: object) -> TypeGuard[str]:
    """Return whether a place is the URL of a file or folder on an object store, rather than a path."""
    return isinstance(place, str) and _URL.match(place) is not None


def require_local(*places: object) -> None:
    """Refuse URLs, which a path would turn into local folders named ``s3:``.

    Raises:
        OptionsError: if a place is one.
    """
    for place in places:
        if is_url(place):
            raise OptionsError(f"{place} is a URL, which only posefuse batch reads and writes. Specify a local path.")


def checked_url(text: str) -> str:
    """Return a URL without a slash at its end.

    Raises:
        FileError: if it names no bucket, or its library is not installed.
    """
    scheme, _, rest = text.partition("://")
    url = f"{scheme.lower()}://{rest.strip('/')}"
    if not rest.strip("/"):
        raise FileError(
            f"{text} names no bucket. Specify a folder in one, such as {scheme}://bucket/recordings/take_1."
        )
    _file_system(url)
    return url


def joined(url: str, name: str) -> str:
    """Return the URL of a file or folder in a folder."""
    return f"{url}/{name}" if name else url


def name_of(url: str) -> str:
    """Return the last part of a URL."""
    return url.rpartition("/")[2]


def parents_of(url: str) -> list[str]:
    """Return the folders above a URL, the nearest first; the last one is the bucket."""
    scheme, _, rest = url.partition("://")
    return [f"{scheme}://{parent}" for parent in PurePosixPath(rest).parents if str(parent) != "."]


def list_files(url: str) -> dict[str, StoredFile]:
    """Return the files in a folder and below it by their names relative to it; none if there is no such folder.

    Raises:
        StoreError: if the store has no such bucket, does not answer, or denies access.
    """
    store, path = _file_system(url)
    with _explained(url):
        store.invalidate_cache()
        found = store.find(path, detail=True)
    files = {}
    for name, details in found.items():
        inside = name[len(path) :].strip("/")
        # Consoles represent an empty folder by an empty object whose name ends in a slash.
        if details.get("type") == "file" and not name.endswith("/"):
            files[inside] = StoredFile(joined(url, inside), int(details.get("size") or 0), _version(details))
    return dict(sorted(files.items()))


def list_entries(url: str) -> tuple[list[str], list[StoredFile]]:
    """Return the names of the folders directly in a folder, and the files directly in it.

    Raises:
        StoreError: if the store has no such bucket, does not answer, or denies access.
    """
    store, path = _file_system(url)
    with _explained(url):
        store.invalidate_cache()
        try:
            entries = store.ls(path, detail=True)
        except FileNotFoundError:
            if store.exists(path.partition("/")[0]):
                return [], []
            raise
    named = [(str(entry["name"]).rstrip("/").rpartition("/")[2], entry) for entry in entries]
    folders = sorted(name for name, entry in named if entry["type"] == "directory")
    files = [
        StoredFile(joined(url, name), int(entry.get("size") or 0), _version(entry))
        for name, entry in named
        if entry["type"] == "file" and not str(entry["name"]).endswith("/")
    ]
    return folders, sorted(files, key=lambda file: file.url)


def matching_folders(pattern: str) -> list[str]:
    """Return the folders that match a URL with ``*`` in place of names, which a shell does not expand.

    Raises:
        FileError: if there is none.
    """
    start, _, scheme_rest = pattern.partition("://")
    found = [f"{start}://{scheme_rest.partition('/')[0]}"]
    for part in scheme_rest.split("/")[1:]:
        if "*" not in part:
            found = [joined(url, part) for url in found]
            continue
        matches = re.compile(".*".join(re.escape(text) for text in part.split("*"))).fullmatch
        found = [joined(url, name) for url in found for name in list_entries(url)[0] if matches(name)]
    if not found:
        raise FileError(f"No folder matches {pattern}.")
    return found


def download(files: Mapping[Path, StoredFile]) -> None:
    """Download files side by side.

    Args:
        files: what to download, by the path of the copy. Its folder is created.

    Raises:
        StoreError: if the store does not answer, denies access, or a file is not as it was listed.
    """
    for path in files:
        path.parent.mkdir(parents=True, exist_ok=True)
    for url, group in _by_store((file.url, path) for path, file in files.items()).items():
        store, _ = _file_system(url)
        with _explained(url):
            store.get([_file_system(each)[1] for each, _ in group], [str(path) for _, path in group])
    for path, file in files.items():
        if not path.is_file() or path.stat().st_size != file.size:
            raise StoreError(f"{file.url} changed while it was downloaded.", transient=True)


def upload(files: Mapping[str, Path]) -> None:
    """Upload files side by side.

    Args:
        files: paths of files by the URL of the copy.

    Raises:
        StoreError: if the store has no such bucket, does not answer, or denies access.
    """
    for url, group in _by_store(files.items()).items():
        store, _ = _file_system(url)
        with _explained(url):
            store.put([str(path) for _, path in group], [_file_system(each)[1] for each, _ in group])


def read_stored(url: str) -> bytes | None:
    """Return the content of a file, or None if it does not exist.

    Raises:
        StoreError: if the store does not answer, or denies access.
    """
    store, path = _file_system(url)
    with _explained(url), contextlib.suppress(FileNotFoundError):
        return store.cat_file(path)
    return None


def write_stored(url: str, content: bytes) -> None:
    """Write a small file, which replaces one of the same name at once.

    Raises:
        StoreError: if the store has no such bucket, does not answer, or denies access.
    """
    store, path = _file_system(url)
    with _explained(url):
        store.pipe_file(path, content)


def remove(urls: Iterable[str]) -> None:
    """Remove files; those that do not exist are ignored.

    Raises:
        StoreError: if the store does not answer, or denies access.
    """
    for url, group in _by_store((url, None) for url in urls).items():
        store, _ = _file_system(url)
        with _explained(url), contextlib.suppress(FileNotFoundError):
            store.rm([_file_system(each)[1] for each, _ in group])


def _by_store(pairs: Iterable[tuple[str, Any]]) -> dict[str, list[tuple[str, Any]]]:
    """Return pairs of a URL and a value in groups of one bucket."""
    groups: dict[str, list[tuple[str, Any]]] = {}
    for url, value in pairs:
        scheme, _, rest = url.partition("://")
        groups.setdefault(f"{scheme}://{rest.partition('/')[0]}", []).append((url, value))
    return groups


def _version(details: Mapping[str, Any]) -> str:
    return next((str(details[name]).strip('"') for name in _VERSIONS if details.get(name)), "")


def _file_system(url: str) -> tuple[Any, str]:
    """Return fsspec's file system of a URL, and the path in it.

    Raises:
        FileError: if a library is not installed, or the kind of the store is unknown.
    """
    scheme = url.partition("://")[0]
    if importlib.util.find_spec("fsspec") is None:
        raise FileError(f"{url} needs fsspec, which is not installed. {_INSTALL}")
    import fsspec
    from fsspec.registry import known_implementations

    try:
        store = fsspec.filesystem(scheme)
    except ImportError as error:
        hint = (
            _INSTALL if scheme in ("s3", "s3a", "gs", "gcs") else str(known_implementations[scheme].get("err", error))
        )
        raise FileError(f"{url} needs a library that is not installed: {error}. {hint}") from None
    except ValueError:
        kinds = choices(("s3://", "gs://", *(f"{name}://" for name in ("abfs", "az") if name in known_implementations)))
        raise FileError(
            f"{url}: {scheme}:// is no object store that fsspec knows. Specify a folder, or {kinds}."
        ) from None
    return store, store._strip_protocol(url)


@contextlib.contextmanager
def _explained(url: str) -> Iterator[None]:
    """Turn the errors of the libraries of all stores into sentences.

    Raises:
        StoreError: if the block raises one.
    """
    try:
        yield
    except (FileError, KeyboardInterrupt):
        raise
    except Exception as error:
        raise _explanation(url, error) from None


def _explanation(url: str, error: Exception) -> StoreError:
    scheme, _, rest = url.partition("://")
    bucket = f"{scheme}://{rest.partition('/')[0]}"
    what = " ".join(str(error).split())[:200] or type(error).__name__
    if any(part in type(error).__name__ for part in _NO_CREDENTIALS) or any(a in what.lower() for a in _ANONYMOUS):
        remedy = _CREDENTIALS.get({"s3a": "s3", "gcs": "gs"}.get(scheme, scheme), "Configure them for this store")
        return StoreError(f"No credentials for {bucket}: {what.rstrip('.')}. {remedy}.")
    if isinstance(error, PermissionError):
        return StoreError(
            f"{bucket} denies access: {what.rstrip('.')}. The credentials must allow listing, reading, writing and "
            "deleting in this bucket."
        )
    if isinstance(error, FileNotFoundError) or any(text in what.lower() for text in _INVALID):
        return StoreError(
            f"There is no bucket {bucket}, or what was listed in it was removed ({what.rstrip('.')}). Create the "
            "bucket, or correct its name."
        )
    return StoreError(
        f"{bucket} does not answer as expected: {type(error).__name__}: {what.rstrip('.')}. Check the network and, for "
        "a store of your own, its address (AWS_ENDPOINT_URL for S3).",
        transient=True,
    )
