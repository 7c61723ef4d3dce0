"""Damaged results, track tables and edits raise errors."""

import numpy as np
import pytest

import posefuse
from posefuse.errors import PosefuseError
from posefuse.io.results import trc
from posefuse.model.options.options import Options
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate
from tests.broken import broken

EDITS = """
[[swap]]
people = ["person_1", "person_2"]
frames = [3, 9]

[[drop]]
person = "person_3"
"""


@pytest.fixture(scope="module")
def result():
    scene = simulate(SceneOptions(skeleton="body_25", duration_s=0.1, cameras=3))
    return posefuse.reconstruct(scene.rig, scene.detections, Options(solve="frame", noise_scale_px=4.0))


def everything(path) -> None:
    """Return the whole contents of the file."""
    actual = posefuse.read_reconstruction(path)
    for _ in actual.chunks(4):
        pass


def write(kind, result, folder):
    if kind == "edits":
        (folder / "edits.toml").write_text(EDITS)
        return folder / "edits.toml", posefuse.read_edits
    if kind == "trc":
        posefuse.write(result, folder / "person.trc")
        return folder / "person.trc", trc.read
    posefuse.write(result, folder / "reconstruction.nc")
    return folder / "reconstruction.nc", everything


def refused(kind, result, folder, cases) -> int:
    """Return how many of a number of damaged files raise an error."""
    path, read = write(kind, result, folder)
    original, rng, n = path.read_bytes(), np.random.default_rng(len(kind)), 0
    for _ in range(cases):
        path.write_bytes(broken(original, rng))
        try:
            read(path)
        except PosefuseError:
            n += 1
    return n


# The netCDF library fails to close a file that it could not open.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("kind", ["edits", "trc", "netcdf"])
def test_broken_files_raise_posefuse_errors(kind, result, tmp_path):
    assert refused(kind, result, tmp_path, 40 if kind == "netcdf" else 200) > 10


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("kind", ["edits", "trc", "netcdf"])
def test_many_broken_files_raise_posefuse_errors(kind, result, tmp_path):
    assert refused(kind, result, tmp_path, 10_000) > 100
