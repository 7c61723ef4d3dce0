"""Results in formats of other programs are read back, as far as the format represents them."""

import tempfile
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import posefuse
from posefuse.io.results.names import safe_names
from posefuse.io.results.write import person_paths
from posefuse.model.cameras import LensModel
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.stored_points import StoredPoints, stored_points
from tests.properties import examples
from tests.properties.test_round_trips import any_result, any_rig, seeds

# pandas and netCDF truncate strings at the first zero byte; CSV writers end lines with carriage returns.
names = st.text(st.characters(codec="utf-8", exclude_characters="\x00\r", exclude_categories=["Cs"]), max_size=8)
hostile = st.sampled_from(
    ["../../x", "/etc/x", "..", ".", "a/b", "C:\\x", "CON", "nul.txt", "x" * 300, "a\nb", "a,b", '"', ""]
)
anybody = st.one_of(names, hostile)

EVERYTHING = {f.name for f in fields(StoredPoints)}
CARRIES = {
    "parquet": EVERYTHING,
    "sleap": EVERYTHING - {"sd_m", "n_views"},
    "movement": EVERYTHING - {"sd_m"},
    "npz": EVERYTHING - {"sd_m", "n_views"},
    "freemocap": EVERYTHING - {"sd_m", "n_views"},
    "nwb": EVERYTHING - {"sd_m", "n_views"},
    "h5": EVERYTHING - {"sd_m", "n_views"},
    "csv": EVERYTHING - {"layer", "rate_hz", "covariance_m2", "view_names", "view_status", "view_error_px"},
    "anipose": {"keypoints", "frame_numbers", "points_m", "n_views", "reprojection_error_px"},
    "dlc": {"keypoints", "person_ids", "frame_numbers", "points_m", "layer"},
}
"""Fields that each format keeps; the others are None or empty."""

NEEDED = ("person_ids",)
"""Fields derived from the file name because the file lacks them."""

FILES = {
    "parquet": ("parquet", "p.parquet"),
    "sleap": ("sleap", "p.h5"),
    "movement": ("movement", "p.nc"),
    "npz": ("npz", "p.npz"),
    "freemocap": ("freemocap", "p"),
    "nwb": ("nwb", "p.nwb"),
    "h5": ("deeplabcut", "p.h5"),
    "csv": ("csv", "p.csv"),
    "anipose": ("anipose", "p.csv"),
    "dlc": ("deeplabcut", "p.csv"),
}
ONE_PERSON = ("npz", "freemocap", "anipose")
ROWS_WITHOUT_GAPS = ("anipose", "dlc")
_OF_CSV = {
    "points_m": (1e-15, 1e-6), "time_s": (0.0, 1e-6), "sd_m": (1e-3, 1e-11), "reprojection_error_px": (1e-3, 1e-11),
}  # fmt: skip
"""Largest relative and absolute differences of CSV files, which have a limited number of digits."""


def some_result(seed: int, people: list[str], keypoints: list[str], cameras: list[str], frames: int) -> Reconstruction:
    """Return random numbers, a third of them missing, with gaps between the frames."""
    rng = np.random.default_rng(seed)
    result = any_result(rng, any_rig(rng, cameras, [LensModel.BROWN] * len(cameras)), people, frames)
    layer = result.layers["measured"]
    covariance = np.array(layer.covariance_m2)
    covariance[..., [0, 3, 5]] = np.abs(covariance[..., [0, 3, 5]])
    points = np.array(layer.points_m)
    points[np.isnan(points).any(axis=-1)] = np.nan
    layer = replace(
        layer,
        covariance_m2=covariance,
        points_m=points,
        reprojection_error_px=np.abs(layer.reprojection_error_px),
    )
    skeleton = replace(result.skeleton, keypoints=tuple(keypoints), edges=((keypoints[0], keypoints[1]),))
    return replace(result, skeleton=skeleton, layers={"measured": layer}, tracks=None)


def results(most_frames: int = 6) -> st.SearchStrategy[dict[str, Any]]:
    """Arguments of :func:`some_result`: one person or several, with any names."""
    word = names.filter(bool)
    return st.fixed_dictionaries(
        {
            "seed": seeds,
            "people": st.lists(anybody, min_size=1, max_size=3, unique=True),
            "keypoints": st.lists(word, min_size=4, max_size=4, unique=True),
            "cameras": st.lists(word, min_size=1, max_size=3, unique=True),
            "frames": st.integers(1, most_frames),
        }
    )


def written_and_read(result: Reconstruction, kind: str) -> list[StoredPoints]:
    """Read all files, which must be in the expected folder."""
    form, name = FILES[kind]
    with tempfile.TemporaryDirectory() as outside:
        folder = Path(outside) / "result"
        folder.mkdir()
        done = posefuse.write(result, folder / name, form)
        assert [entry.name for entry in Path(outside).iterdir()] == ["result"]
        assert {file.name for file in done.files} == {entry.name for entry in folder.iterdir()}
        return [posefuse.read_points(file, form) for file in done.files]


def expected(result: Reconstruction, kind: str) -> list[StoredPoints]:
    whole = [[person] for person in result.person_ids] if kind in ONE_PERSON else [list(result.person_ids)]
    return [stored_points(result, "measured", people) for people in whole]


def check(actual: StoredPoints, original: StoredPoints, kind: str, rtol: float = 0.0) -> None:
    """Check that the fields of the format are equal and all others absent."""
    places = np.arange(original.n_frames)
    if kind in ROWS_WITHOUT_GAPS:
        places = original.frame_numbers - original.frame_numbers[0]
        between = np.setdiff1d(np.arange(actual.n_frames), places)
        assert np.isnan(actual.points_m[between]).all()
        np.testing.assert_array_equal(np.diff(actual.frame_numbers), 1)
    for name in sorted(EVERYTHING):
        a, b = getattr(actual, name), getattr(original, name)
        if name not in CARRIES[kind]:
            present = np.isfinite(a).any() if name == "time_s" else a not in (None, "") and name not in NEEDED
            assert not present, name
        elif isinstance(b, np.ndarray):
            if name == "n_views" and kind == "anipose":
                b = np.where(np.isnan(original.points_m).any(axis=-1), 0, b)
            limits = _OF_CSV.get(name, (0.0, 0.0)) if kind == "csv" else (rtol, 0.0)
            np.testing.assert_allclose(a[places], b, *limits, err_msg=name)
        elif name == "person_ids" and kind == "dlc" and len(b) == 1:
            assert a == ("p",)
        else:
            assert a == b, name


@pytest.mark.parametrize("kind", [kind for kind in FILES if kind != "nwb"])
@given(arguments=results())
@examples(8)
def test_written_results_are_read_back(kind, arguments):
    result = some_result(**arguments)
    # Conversion to millimeters and back may change the last digit.
    rtol = 1e-15 if kind in ("npz", "freemocap") else 0.0
    for actual, given_ in zip(written_and_read(result, kind), expected(result, kind), strict=True):
        check(actual, given_, kind, rtol)


@given(arguments=results(most_frames=3))
@examples(3)
def test_nwb_is_read_back(arguments):
    result = some_result(**arguments)
    for actual, given_ in zip(written_and_read(result, "nwb"), expected(result, "nwb"), strict=True):
        check(actual, given_, "nwb")


@given(people=st.lists(anybody, min_size=1, max_size=6, unique=True))
@examples(100)
def test_file_names_stay_in_their_folder(people):
    folder = Path("/somewhere/inside")
    paths = person_paths(folder / "x.csv", people)
    assert len({str(path).casefold() for path in paths}) == len(people)
    for name, path in zip(safe_names(people), paths, strict=True):
        assert path.parent == folder
        assert name not in ("", ".", "..")
        assert len(name.encode()) <= 104
        assert not set(name) & set('/\\:*?"<>|\0\n')
    assert safe_names(safe_names(people)) == safe_names(people)
