"""Parts of self-contained pages: assets, scripts and their data."""

import json
from collections.abc import Iterable
from importlib.resources import files
from string import Template
from typing import Any


def asset(name: str) -> str:
    """Return the text of a file of the package that pages contain."""
    return files("posefuse.report").joinpath("assets", name).read_text("utf-8")


def document(name: str, *, title: str, css: Iterable[str], **parts: str) -> str:
    """Return a page as the text of an HTML file that needs no network.

    Args:
        name: the asset with the body of the page, whose placeholders are ``title`` and the parts.
        title: title of the page, as HTML.
        css: names of the assets with its styles.
        parts: contents of the placeholders, as HTML.
    """
    body = Template(asset(name)).substitute(title=title, **parts)
    return Template(asset("frame.html")).substitute(title=title, css="".join(map(asset, css)), body=body)


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
