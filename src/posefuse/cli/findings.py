"""What the recording check is certain of, and the exit code that follows."""

import sys
from collections.abc import Sequence
from typing import Annotated

from cyclopts import Parameter

from posefuse.cli.console import print_problem
from posefuse.model.findings import Finding, certain_faults

CERTAIN_FAULT = 3
"""Exit code of a command that finishes, but whose recording certainly has a fault that makes results wrong."""

AcceptFindings = Annotated[bool, Parameter(negative="", help="Exit with 0 even if results are certainly wrong.")]


def exit_on_certain_faults(findings: Sequence[Finding], accept: bool, result: str) -> None:
    """Print the worst fault that is certain, and exit, unless the user accepts findings.

    Args:
        findings: of the recording check, the most serious first.
        accept: whether the user accepts them.
        result: what is wrong because of the fault, as the subject of a clause.
    """
    faults = certain_faults(findings)
    if accept or not faults:
        return
    first, *others = faults
    more = "" if not others else f" (and {len(others)} more)"
    print_problem(
        "error: ",
        "bold red",
        f"{first.sentence.rstrip('.')}{more}, so {result} wrong; correct it, or give --accept-findings to exit with 0 "
        f"instead of {CERTAIN_FAULT}.",
    )
    sys.exit(CERTAIN_FAULT)
