"""Figures of a result: each is drawn, says its names as they are, and wrong calls are answered."""

import html
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest

from posefuse.cli.main import main
from posefuse.cli.plot import FIGURE_NAMES
from posefuse.errors import OptionsError, SkeletonError
from posefuse.io.results import netcdf
from posefuse.report.plots import FIGURES, draw, shown_of
from tests.people import crowd, followed, nobody

HOSTILE = "<b>$x_1$ & co"


@pytest.fixture(scope="module")
def scene():
    return crowd(people=2, seconds=1.0)


@pytest.fixture(scope="module")
def result(scene):
    whole = followed(scene)
    first, *others = whole.rig.cameras
    return replace(whole, rig=replace(whole.rig, cameras=(replace(first, name=HOSTILE), *others)))


def test_the_command_lists_what_there_is():
    assert tuple(FIGURES) == FIGURE_NAMES


@pytest.mark.parametrize("name", [name for name in FIGURE_NAMES if name != "angles"])
def test_every_figure_is_drawn(name, result):
    drawn = draw(name, shown_of(result, None, ("nose", "left_knee")))
    assert drawn.png.startswith(b"\x89PNG")
    ElementTree.fromstring(drawn.svg)
    if name in ("errors", "shares"):
        assert html.unescape(drawn.svg.decode()).count(HOSTILE) >= 2


def test_the_same_bytes(result):
    one, other = (draw("lives", shown_of(result, "measured")) for _ in range(2))
    assert one == other


def test_who_is_not_there_is_not_drawn(scene, result):
    assert draw("time", shown_of(nobody(scene), None)) is None
    assert draw("lives", shown_of(replace(result, tracks=None, swaps=None), None)) is None


def test_angles_are_those_of_fitted_bodies(result):
    # These bodies' segments are not those of the skeleton: there are no angles to read from them.
    assert draw("angles", shown_of(result, None)) is None


def test_wrong_names_are_answered(result):
    with pytest.raises(OptionsError, match="no figure 'eror'. Did you mean 'errors'"):
        draw("eror", shown_of(result, None))
    with pytest.raises(SkeletonError, match="no keypoint 'noze'"):
        shown_of(result, None, ("noze",))


class TestCommand:
    @pytest.fixture
    def folder(self, result, tmp_path):
        np.testing.assert_equal(len(result.person_ids), 2)
        (tmp_path / "result").mkdir()
        netcdf.write(result.chunks(), tmp_path / "result" / "reconstruction.nc")
        return tmp_path

    def test_it_writes_both_forms_of_what_is_asked(self, folder, capsys):
        main(["plot", str(folder / "result"), "--figure", "lives", "--output", str(folder / "out")])
        assert sorted(path.name for path in (folder / "out").iterdir()) == ["lives.png", "lives.svg"]
        assert "Wrote lives.png, lives.svg" in capsys.readouterr().out

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [(["--figure", "live"], "no figure 'live'"), (["--figure", "angles"], "nothing to draw in")],
    )
    def test_it_leaves_nothing_behind_when_it_cannot(self, folder, capsys, arguments, words):
        with pytest.raises(SystemExit) as stopped:
            main(["plot", str(folder / "result"), *arguments, "--output", str(folder / "out")])
        assert stopped.value.code == 2
        assert words in " ".join(capsys.readouterr().err.split())
        assert not (folder / "out").exists()
