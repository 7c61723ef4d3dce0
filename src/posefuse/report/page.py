"""Parts of self-contained pages: assets, scripts and their data."""

import json
from collections.abc import Iterable
from importlib.resources import files
from typing import Any


def asset(name: str) -> str:
    """Return the text of a file of the package that pages contain."""
    return files("posefuse.report").joinpath("assets", name).read_text("utf-8")


def script(parts: Iterable[str], constants: Iterable[str]) -> str:
    """Return scripts wrapped in one function, which keeps their names out of the global scope.

    Args:
        parts: names of the assets, in this order.
        constants: names of the data that the scripts read from the page.
    """
    data = f'const {{ {", ".join(constants)} }} = JSON.parse(document.getElementById("data").textContent);'
    return "\n".join(['"use strict";', "(() => {", data, *(asset(name) for name in parts), "})();"])


def safe_json(data: Any) -> str:
    """Return JSON that cannot close the script element around it."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c").replace("&", "\\u0026")
