"""The table of ablations in the documentation has the labels that the benchmark prints."""

from benchmarks.people import ABLATION_HEAD, ABLATIONS

from tests.conftest import ROOT


def test_documented_ablations_are_those_of_the_benchmark() -> None:
    page = (ROOT / "docs" / "benchmarks.md").read_text("utf-8")
    table = page.split("### Ablations")[1].split(ABLATION_HEAD)[1].split("\n\n")[0].strip()
    documented = [tuple(cell.strip() for cell in row.split("|")[1:3]) for row in table.splitlines()]
    printed = [(each.what, scenario) for each in ABLATIONS for scenario in each.scenarios]
    assert len(documented) > 15
    assert set(documented) <= set(printed)
    assert documented == [row for row in printed if row in documented]
