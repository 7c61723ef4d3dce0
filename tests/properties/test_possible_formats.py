"""A format that cannot hold a result is refused before the result is made, by the facts that are known then."""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse.errors import PosefuseError
from posefuse.io.results.format import ResultFacts
from posefuse.io.results.write import additional_names, require_formats, write
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton
from tests.properties import examples
from tests.properties.test_result_files import some_result

CAMERAS = (["left", "right"], ["only"], ["../up", "right"], ["a/b", "c"])


def result_with(cameras: list[str], *, human: bool, gap: int, known_times: bool, rate: bool) -> Reconstruction:
    skeleton = shipped_skeleton("halpe_26") if human else Skeleton("creature", tuple(f"k{i}" for i in range(5)), ())
    result = some_result(0, ["person_1"], list(skeleton.keypoints[:4]), cameras, 3)
    layer = result.layers["measured"]
    shape = (3, 1, len(skeleton))
    grown = {
        name: np.resize(np.asarray(getattr(layer, name)), (*shape, *np.asarray(getattr(layer, name)).shape[3:]))
        for name in layer.__dataclass_fields__
        if isinstance(getattr(layer, name), np.ndarray)
    }
    numbers = np.array([0, 1, 2 + gap])
    times = np.array([0.0, 0.1, 0.2 if rate else 1.7]) if known_times else np.array([0.0, np.nan, 0.2])
    return replace(
        result, skeleton=skeleton, layers={"measured": replace(layer, **grown)}, frame_numbers=numbers, time_s=times,
        rate_hz=10.0 if rate else None, unit="px" if len(cameras) == 1 else "m", tracks=None, swaps=None, poses=None,
    )  # fmt: skip


def refused(call) -> bool:
    try:
        call()
    except PosefuseError:
        return True
    return False


@pytest.mark.parametrize("form", additional_names())
@examples(12)
@given(
    cameras=st.sampled_from(CAMERAS),
    human=st.booleans(),
    gap=st.sampled_from([0, 5, 100_000]),
    known_times=st.booleans(),
    rate=st.booleans(),
)
def test_refused_before_as_after(form, cameras, human, gap, known_times, rate):
    result = result_with(cameras, human=human, gap=gap, known_times=known_times, rate=rate)
    before = refused(lambda: require_formats([form], ResultFacts.of(result)))
    with tempfile.TemporaryDirectory() as folder:
        after = refused(lambda: write(result, Path(folder) / additional_names()[form], form))
    assert before == after


@pytest.mark.parametrize("package", ["pynwb", "ndx_pose"])
def test_missing_packages_are_refused_before(package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    result = result_with(["left", "right"], human=True, gap=0, known_times=True, rate=True)
    with pytest.raises(PosefuseError, match="NWB needs the packages"):
        require_formats(["nwb"], ResultFacts.of(result))
