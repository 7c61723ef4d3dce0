"""Calls of the package ``opensim``, the optional dependency of ``posefuse opensim`` (extra ``opensim``)."""

import importlib.util
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from posefuse.errors import ResultError

_WORKER = Path(__file__).with_name("worker.py")


def require_opensim() -> None:
    """Check that OpenSim is installed.

    Raises:
        ResultError: if it is not.
    """
    if importlib.util.find_spec("opensim") is None:
        raise ResultError(
            "posefuse opensim needs OpenSim, which is not installed. Run: pip install 'posefuse[opensim]'. Its wheels "
            "are for Python 3.11 to 3.13 on Linux and Windows (x86-64) and on macOS."
        )


def call_opensim(task: str, **arguments: object) -> dict[str, Any]:
    """Run a task of :mod:`posefuse.io.opensim.worker` in another process.

    Returns:
        The answer; ``error`` states why OpenSim failed.

    Raises:
        ResultError: if OpenSim is not installed, or its process ends without an answer.
    """
    require_opensim()
    with tempfile.TemporaryDirectory() as folder:
        request, answer = Path(folder) / "request.json", Path(folder) / "answer.json"
        request.write_text(json.dumps({"task": task, "arguments": arguments}), "utf-8")
        done = subprocess.run(
            [sys.executable, str(_WORKER), str(request), str(answer)], capture_output=True, cwd=folder
        )
        if not answer.is_file():
            lines = done.stderr.decode("utf-8", "replace").strip().splitlines()
            raise ResultError(
                f"OpenSim ended with code {done.returncode} and without an answer: "
                f"{lines[-1][:300] if lines else 'it printed nothing'}"
            )
        return json.loads(answer.read_text("utf-8"))
