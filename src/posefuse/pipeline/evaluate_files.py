"""Compare a result with ground truth in files."""

from collections.abc import Sequence
from pathlib import Path

from posefuse.arguments import checked
from posefuse.evaluation.accuracy import Accuracy, Truth, evaluate
from posefuse.evaluation.paired_results import PeoplePoints
from posefuse.evaluation.people import PeopleScores, ScoringOptions, score_people
from posefuse.io.results.comparable import pair_with_truth
from posefuse.model.options.options import LengthUnit
from posefuse.model.reconstruction import Reconstruction

Scores = Accuracy | PeopleScores


@checked
def evaluate_files(
    result: Reconstruction,
    truth: str | Path | Sequence[str | Path],
    scoring: ScoringOptions | None = None,
    *,
    length_unit: LengthUnit | None = None,
) -> Scores:
    """Compare a result with ground truth in files.

    Args:
        result: result in the calibration's coordinate system; ``options.layer`` or the best layer is compared.
        truth: one file with all people, or one file per person, in any format that :func:`posefuse.read_points`
            reads, or a reconstruction.
        scoring: options for several people.
        length_unit: unit of length of files that do not state it.

    Returns:
        The accuracy if result and truth hold one person each, otherwise the scores of all people.

    Raises:
        FileError: if a file does not exist, is corrupt, or has no supported format.
        ResultError: if result and truth do not fit.
    """
    files = [Path(truth)] if isinstance(truth, str | Path) else [Path(file) for file in truth]
    return score(result, pair_with_truth(result, files, length_unit), scoring)


def score(result: Reconstruction, paired: Truth | PeoplePoints, scoring: ScoringOptions | None = None) -> Scores:
    """Return the accuracy of one person, or the scores of several, from a result paired with its truth."""
    if isinstance(paired, Truth):
        return evaluate(result, paired)
    return score_people(paired, scoring or ScoringOptions())
