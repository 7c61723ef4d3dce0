"""Figures of a result: each is drawn with literal names, and invalid names raise errors."""

import html
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest

from posefuse.cli.main import main
from posefuse.errors import OptionsError, SkeletonError
from posefuse.io.results import netcdf
from posefuse.report.plots.data import gather_plot_data
from posefuse.report.plots.registry import PLOT_NAMES, PLOTS, draw_plot
from tests.people import simulate_walkers, track_perfectly, without_people

HOSTILE = "<b>$x_1$ & co"


@pytest.fixture(scope="module")
def scene():
    return simulate_walkers(people=2, seconds=1.0)


@pytest.fixture(scope="module")
def result(scene):
    whole = track_perfectly(scene)
    first, *others = whole.rig.cameras
    return replace(whole, rig=replace(whole.rig, cameras=(replace(first, name=HOSTILE), *others)))


def test_names_are_unique_and_records_complete():
    assert len(set(PLOT_NAMES)) == len(PLOTS)
    for plot in PLOTS:
        assert callable(plot.load())
        assert plot.description.endswith(".")


@pytest.mark.parametrize("name", [name for name in PLOT_NAMES if name not in ("angles", "gait")])
def test_every_figure_is_drawn(name, result):
    drawn = draw_plot(name, gather_plot_data(result, None, ("nose", "left_knee")))
    assert drawn.png.startswith(b"\x89PNG")
    ElementTree.fromstring(drawn.svg)
    if name in ("errors", "shares"):
        assert html.unescape(drawn.svg.decode()).count(HOSTILE) >= 2


def test_same_result_gives_the_same_bytes(result):
    one, other = (draw_plot("lives", gather_plot_data(result, "measured")) for _ in range(2))
    assert one == other


def test_figures_without_data_are_none(scene, result):
    assert draw_plot("time", gather_plot_data(without_people(scene), None)) is None
    assert draw_plot("lives", gather_plot_data(replace(result, tracks=None, swaps=None), None)) is None


def test_angles_require_a_fitted_model(result):
    # The segments of these simulated bodies differ from the skeleton's, so no angles can be computed.
    assert draw_plot("angles", gather_plot_data(result, None)) is None


def test_unknown_names_raise_errors(result):
    with pytest.raises(OptionsError, match="unknown figure 'eror'. Did you mean 'errors'"):
        draw_plot("eror", gather_plot_data(result, None))
    with pytest.raises(SkeletonError, match="no keypoint 'noze'"):
        gather_plot_data(result, None, ("noze",))


class TestCommand:
    @pytest.fixture
    def folder(self, result, tmp_path):
        np.testing.assert_equal(len(result.person_ids), 2)
        (tmp_path / "result").mkdir()
        netcdf.write(result.chunks(), tmp_path / "result" / "reconstruction.nc")
        return tmp_path

    def test_command_writes_png_and_svg(self, folder, capsys):
        main(["plot", str(folder / "result"), "--figure", "lives", "--output", str(folder / "out")])
        assert sorted(path.name for path in (folder / "out").iterdir()) == ["lives.png", "lives.svg"]
        assert "Wrote lives.png, lives.svg" in capsys.readouterr().out

    @pytest.mark.parametrize(
        ("arguments", "words"),
        [(["--figure", "live"], "unknown figure 'live'"), (["--figure", "angles"], "no data for angles")],
    )
    def test_command_leaves_no_files_after_an_error(self, folder, capsys, arguments, words):
        with pytest.raises(SystemExit) as stopped:
            main(["plot", str(folder / "result"), *arguments, "--output", str(folder / "out")])
        assert stopped.value.code == 2
        assert words in " ".join(capsys.readouterr().err.split())
        assert not (folder / "out").exists()
