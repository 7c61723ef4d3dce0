"""Fixtures of all tests."""

import os
import uuid
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parent.parent
SHARED_DATA = ROOT.parent / "shared" / "data"


@pytest.fixture(autouse=True, scope="session")
def _own_cache(tmp_path_factory):
    """Keep caches out of the home folder, also those of commands in processes of their own."""
    before = os.environ.get("POSEFUSE_CACHE")
    os.environ["POSEFUSE_CACHE"] = str(tmp_path_factory.mktemp("cache"))
    yield
    if before is None:
        del os.environ["POSEFUSE_CACHE"]
    else:
        os.environ["POSEFUSE_CACHE"] = before


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)


@pytest.fixture(scope="session")
def shared_data():
    """Return a function that gives a folder of real recordings by name, or skips the test with a reason."""

    def folder(name: str) -> Path:
        path = SHARED_DATA / name
        if not path.is_dir():
            pytest.skip(f"real recordings are not here: no {path.relative_to(ROOT.parent)} beside the repository")
        return path

    return folder


@pytest.fixture(autouse=True)
def _quiet_without_the_compiler():
    """Idle lanes divide by zero; compiled code does so silently, NumPy's scalars would warn."""
    if os.environ.get("NUMBA_DISABLE_JIT") != "1":
        yield
        return
    with np.errstate(all="ignore"):
        yield


@pytest.fixture(scope="session")
def s3(tmp_path_factory):
    """A local S3 server whose address and credentials are in the environment; the path of its log of requests."""
    for name in ("s3fs", "moto"):
        pytest.importorskip(name, reason=f"{name} is not installed (extra cloud, group dev)")
    from tests.object_stores import CREDENTIALS, environment, s3_server

    log = tmp_path_factory.mktemp("s3") / "requests.log"
    with s3_server(log) as address, environment(AWS_ENDPOINT_URL=address, **CREDENTIALS):
        yield log


@pytest.fixture
def bucket(s3):
    """The URL of a new bucket."""
    from tests.object_stores import make_bucket

    return make_bucket(f"bucket-{uuid.uuid4().hex}")


@pytest.fixture
def google_bucket():
    """The URL of a new bucket on a local server with the interface of Google Cloud Storage."""
    pytest.importorskip("gcsfs", reason="gcsfs is not installed (extra cloud)")
    from tests.google_storage import google_storage_server
    from tests.object_stores import environment

    name = f"bucket-{uuid.uuid4().hex}"
    # The class of file systems with hierarchical folders asks Google itself for the kind of a bucket.
    plain = {"GCSFS_EXPERIMENTAL_ZB_HNS_SUPPORT": "false"}
    with google_storage_server(name) as address, environment(STORAGE_EMULATOR_HOST=address, **plain):
        from fsspec.registry import get_filesystem_class

        kind = get_filesystem_class("gs")
        kind.clear_instance_cache()
        yield f"gs://{name}"
        kind.clear_instance_cache()
