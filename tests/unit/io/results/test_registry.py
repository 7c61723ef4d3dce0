"""Result formats of other programs."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posefuse
from posefuse.errors import FileError, OutputExistsError, PosefuseError, ResultError
from posefuse.io.results import trc
from posefuse.io.results.registry import RESULTS
from posefuse.io.results.write import additional_names
from posefuse.model.reconstruction import Reconstruction
from tests.broken import broken
from tests.properties.test_result_files import FILES, some_result


def test_unknown_formats_are_refused(frame_result, tmp_path):
    with pytest.raises(ResultError, match="No format 'bvhh'"):
        posefuse.write(frame_result, tmp_path / "a.nc", "bvhh")
    with pytest.raises(ResultError, match="ends in no known format. Formats: netcdf, parquet, anipose"):
        posefuse.write(frame_result, tmp_path / "a.xyz")
    posefuse.write(frame_result, tmp_path / "a.xyz", "trc")
    assert trc.read(tmp_path / "a.xyz").rate_hz == 60


def solved(layered_result: Reconstruction) -> np.ndarray:
    return np.asarray(layered_result.layers["solved"].points_m)


def test_format_follows_from_the_file_name(layered_result, tmp_path):
    names = {
        "a.parquet": "parquet", "pose_anipose.csv": "anipose", "x_DLC_3d.csv": "deeplabcut", "DLC_3d.h5": "deeplabcut",
        "points3d.h5": "sleap", "a.movement.nc": "movement", "a.npz": "npz", "a.csv": "csv",
    }  # fmt: skip
    lacks = {
        "pose_anipose.csv": "times, status, covariances, which views",
        "x_DLC_3d.csv": "times, status, errors, covariances, views in CSV",
        "a.csv": "covariances between the axes, and which views",
    }
    for name, form in names.items():
        done = posefuse.write(layered_result, tmp_path / name)
        assert done.files == (tmp_path / name,)
        assert done.layer == "solved"
        assert (
            done.notes[0]
            == f"{form} contains the layer solved, without measured, detections of each track, left/right swaps."
        )
        assert done.notes[1:] == ((f"{form} cannot hold {lacks[name]}.",) if name in lacks else ())
        found, rounding_m = posefuse.read_points(tmp_path / name).points_m, 5.001e-6 if form == "csv" else 0.0
        np.testing.assert_allclose(found, solved(layered_result), rtol=1e-15, atol=rounding_m)
    with pytest.raises(ResultError, match=r"x.h5 may be in the format deeplabcut or sleap"):
        posefuse.write(layered_result, tmp_path / "x.h5")
    with pytest.raises(ResultError, match=r"No format 'parket'. Did you mean 'parquet'"):
        posefuse.write(layered_result, tmp_path / "x", "parket")
    assert posefuse.write(layered_result, tmp_path / "reconstruction.nc").notes == ()


@pytest.mark.parametrize("kind", [kind for kind in FILES if kind != "nwb"])
def test_same_result_gives_the_same_bytes(kind, pair_result, tmp_path):
    form, name = FILES[kind]
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        posefuse.write(pair_result, tmp_path / folder / name, form)
    files = sorted(file.relative_to(tmp_path / "one") for file in (tmp_path / "one").rglob("*") if file.is_file())
    assert files
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes(), file


@pytest.mark.parametrize("kind", FILES)
def test_existing_files_are_replaced_only_on_request_and_only_together(kind, pair_result, tmp_path, monkeypatch):
    form, name = FILES[kind]

    def content() -> dict[Path, bytes]:
        return {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}

    posefuse.write(pair_result, tmp_path / name, form)
    before = content()
    with pytest.raises(OutputExistsError, match="give `overwrite=True` to replace it, or choose another `path`"):
        posefuse.write(pair_result, tmp_path / name, form)
    assert content() == before
    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", disk_is_full)
        with pytest.raises((FileError, OSError)):
            posefuse.write(pair_result, tmp_path / name, form, overwrite=True)
    assert content() == before
    posefuse.write(pair_result, tmp_path / name, form, overwrite=True)
    assert content().keys() == before.keys()


def disk_is_full(*_: object) -> None:
    raise OSError(28, "No space left on device")


def test_points_are_tried_in_a_fixed_order_of_formats():
    order = ["parquet", "anipose", "deeplabcut", "csv", "npz", "freemocap", "movement", "sleap", "nwb", "trc", "c3d"]
    assert [form.name for form in RESULTS if form.read] == order
    assert [form.name for form in RESULTS if form.reads and not form.read] == ["netcdf"]


def test_every_written_format_has_exactly_one_writer():
    for form in RESULTS.written():
        writers = (form.write_layer, form.write_person, form.write_figure, form.write_result)
        assert sum(writer is not None for writer in writers) == 1, form.name
    assert set(additional_names()) <= {form.name for form in RESULTS.written()}


def test_results_without_people_or_frames(pair_result, tmp_path):
    empty = pair_result.frames(0, 0)
    for kind in ("anipose", "sleap", "h5", "npz"):
        form, name = FILES[kind]
        with pytest.raises(ResultError, match="no frames"):
            posefuse.write(empty, tmp_path / name, form)
    sparse = replace(pair_result, frame_numbers=np.array([0, 1, 2, 3, 4, 10**9]))
    with pytest.raises(ResultError, match="1000000001 rows for 6 frames"):
        posefuse.write(sparse, tmp_path / "p.h5", "sleap")
    assert list(tmp_path.iterdir()) == []


def read_broken(kind: str, folder: Path, cases: int) -> int:
    """Read a number of damaged files of a format and return how many were accepted."""
    source = some_result(3, ["anna"], ["nose", "tail", "left_paw", "right_paw"], ["a"], 3)
    form, name = FILES[kind]
    folder.mkdir()
    path = posefuse.write(source, folder / name, form).files[0]
    files = sorted(
        file for file in folder.rglob("*") if file.is_file() and (form != "freemocap" or file.suffix != ".csv")
    )
    files = [file for file in files if form != "freemocap" or file.stem in _READ]
    rng, read = np.random.default_rng(len(kind)), 0
    for case in range(cases):
        file = files[case % len(files)]
        original = file.read_bytes()
        file.write_bytes(broken(original, rng))
        try:
            points = posefuse.read_points(path, form)
        except PosefuseError:
            pass
        else:
            assert points.points_m.shape == (points.n_frames, len(points.person_ids), len(points.keypoints), 3)
            read += 1
        file.write_bytes(original)
    return read


_READ = (
    "posefuse", "coco_17_skeleton_3d", "chain_skeleton_3d", "frame_number", "time_s", "status", "source", "view_status",
    "covariance_m2", "reprojection_error_px", "view_error_px",
)  # fmt: skip


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::RuntimeWarning")
@pytest.mark.parametrize("kind", [kind for kind in FILES if kind != "nwb"])
def test_broken_files_raise_posefuse_errors(kind, tmp_path):
    assert read_broken(kind, tmp_path / "k", 200) < 200


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::RuntimeWarning")
@pytest.mark.parametrize("kind", FILES)
def test_many_broken_files_raise_posefuse_errors(kind, tmp_path):
    assert read_broken(kind, tmp_path / "k", 10_000) < 10_000
