"""Report over a batch."""

from posefuse.model.batch import JobResult, ResultStatistics
from posefuse.report.batch import batch_csv, batch_page, names_in_csv

STATISTICS = ResultStatistics(30, 1.0, 4, 2, 0.98, 12.0, 24.0, None)


def test_names_are_escaped_in_the_page():
    evil = '<script>alert("x")</script>'
    page = batch_page([JobResult(evil, "failed", evil), JobResult("../" + evil, "done", "", STATISTICS, (evil,))])
    assert "<script" not in page
    assert page.count("&lt;script&gt;") == 5
    assert "98.0 %" in page
    table = batch_csv([JobResult('a,"b"\n', "failed", "why"), JobResult("c", "kept", "", STATISTICS)])
    assert table.splitlines()[0].startswith("recording,outcome,frames,seconds,cameras,people,points_share")
    assert table.endswith("c,reconstructed,30,1.0,4,2,0.98,12.0,24.0,,,\n")


def test_warnings_have_a_row_of_their_own():
    page = batch_page([JobResult("walk", "done", "", STATISTICS, ("No common trigger.", "Set `sync`."))])
    numbers, warnings = page.split('<tr class="warned">')[1].split('<tr class="warning">')
    assert "No common trigger" not in numbers
    assert warnings.startswith('<td colspan="10">')
    assert "<p>No common trigger.</p>" in warnings


def test_kept_results_are_written_like_new_ones():
    done, before = (JobResult("c", state, "", STATISTICS) for state in ("done", "kept"))
    assert (batch_csv([done]), batch_page([done])) == (batch_csv([before]), batch_page([before]))


def test_recordings_that_failed_have_no_result_to_lose(tmp_path):
    path = tmp_path / "batch.csv"
    path.write_text(
        batch_csv([JobResult("good", "kept", "", STATISTICS), JobResult("absent", "failed", "No recording.")])
    )
    assert names_in_csv(path) == ["good"]
