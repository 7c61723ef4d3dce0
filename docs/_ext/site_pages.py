"""Small adjustments that make the Markdown pages, which GitHub shows as they are, pages of the site."""

from typing import Any

from sphinx.application import Sphinx
from sphinx.domains.python import PyObject

_TREES = {
    "methods/README": ("*",),
    "benchmarks": ("cost",),
}
"""Page to the pages below it. GitHub would show a table of contents in the page as a block of code."""


def drop_empty_patterns(app: Sphinx, docname: str, source: list[str]) -> None:
    """Remove patterns that match no page from a table of contents, which would be warnings."""
    if ":glob:" in source[0]:
        lines = source[0].split("\n")
        source[0] = "\n".join(line for line in lines if not line.endswith("*") or any(app.srcdir.glob(f"{line}.md")))


def add_tree(app: Sphinx, docname: str, source: list[str]) -> None:
    """Append the hidden table of contents of a page."""
    if docname in _TREES:
        below = "\n".join(_TREES[docname])
        source[0] += f"\n\n```{{toctree}}\n:hidden:\n:glob:\n\n{below}\n```\n"


def reset_figures(gallery_conf: dict[str, Any], fname: str) -> None:
    """Give all figures of the gallery the same style."""
    import matplotlib as mpl

    mpl.rcParams.update({
        "figure.figsize": (6.4, 3.8), "figure.constrained_layout.use": True, "savefig.bbox": None, "font.size": 10,
        "axes.spines.top": False, "axes.spines.right": False, "axes.titlelocation": "left",
    })  # fmt: skip


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the adjustments."""
    for each in PyObject.doc_field_types:
        if each.name == "variable":
            each.label = "Attributes"
    app.connect("source-read", drop_empty_patterns)
    app.connect("source-read", add_tree)
    return {"parallel_read_safe": True}
