"""Findings of the recording check as JSON text, as stored in a result file."""

import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from posefuse.model.findings import Finding, FindingKind

_MAYBE_NAN = ("size", "sd")


def findings_to_json(findings: Iterable[Finding]) -> str:
    """Return findings as a JSON list, with null in place of NaN."""
    return json.dumps([_record(each) for each in findings])


def findings_from_json(text: str) -> tuple[Finding, ...]:
    """Return the findings of a JSON list that :func:`findings_to_json` wrote."""
    return tuple(_finding(record) for record in json.loads(text))


def _record(finding: Finding) -> dict[str, Any]:
    record = asdict(finding)
    return record | {name: None for name in _MAYBE_NAN if math.isnan(record[name])}


def _finding(record: dict[str, Any]) -> Finding:
    frames = None if record["frames"] is None else tuple(record["frames"])
    values: dict[str, Any] = {
        **record,
        "kind": FindingKind(record["kind"]),
        "cameras": tuple(record["cameras"]),
        "frames": frames,
    }
    values.update({name: math.nan for name in _MAYBE_NAN if record[name] is None})
    return Finding(**values)
