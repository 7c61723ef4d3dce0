"""Write one page for each public name and for each type that public calls return, from their docstrings.

The pages are written into docs/generated/api, which git ignores.
"""

import inspect
import re
import typing
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util.typing import stringify_annotation

import posefuse

_SECTIONS = {
    "Reading and writing": ("io",),
    "Reconstruction": ("pipeline.reconstruct", "pipeline.run", "pipeline.detect", "pipeline.compare_methods"),
    "Tracking and identities": ("pipeline.track_live", "tracking", "editing", "model.frames", "model.tracks",
                                "pipeline.contact_sheet", "pipeline.report_videos"),
    "Calibration": ("pipeline.calibrat", "pipeline.recalibrate", "pipeline.refine", "pipeline.place", "calibration",
                    "model.board", "model.scene_points", "model.camera_covariance"),
    "Time": ("pipeline.sync", "pipeline.start_tag", "preprocess", "model.clock"),
    "Quality and evaluation": ("pipeline.diagnose", "evaluation", "pipeline.evaluate", "pipeline.compare",
                               "pipeline.calibrate_noise", "model.findings"),
    "Biomechanics": ("biomechanics", "pipeline.opensim"),
    "Simulation": ("synthetic",),
    "Options": ("model.options",),
    "Data types": ("model", "skeleton"),
    "Errors": ("errors",),
}  # fmt: skip
"""Section to prefixes of modules; the longest prefix decides."""


def public_names() -> dict[str, Any]:
    """Return the public objects by name."""
    return {name: getattr(posefuse, name) for name in posefuse.__all__}


def returned_types() -> list[type]:
    """Return the types that public calls and attributes lead to and that have no public name."""
    known = set(filter(inspect.isclass, public_names().values()))
    queue, found = list(public_names().values()), []
    while queue:
        for kind in _types_from(queue.pop(0)):
            if kind not in known and kind.__module__.startswith("posefuse."):
                known.add(kind)
                found.append(kind)
                queue.append(kind)
    return sorted(found, key=lambda kind: kind.__name__)


def _types_from(thing: Any) -> Iterator[type]:
    """Yield the classes in what a function returns, or in the attributes and methods of a class."""
    if not inspect.isclass(thing):
        yield from _classes_in(_hints(thing).get("return"))
        return
    if issubclass(thing, Enum | BaseException):
        return
    for name, hint in _hints(thing).items():
        if not name.startswith("_"):
            yield from _classes_in(hint)
    for name, member in vars(thing).items():
        function = getattr(member, "fget", None) or getattr(member, "func", None) or getattr(member, "__func__", member)
        if not name.startswith("_") and inspect.isfunction(function):
            yield from _classes_in(_hints(function).get("return"))


def _hints(thing: Any) -> dict[str, Any]:
    try:
        return typing.get_type_hints(inspect.unwrap(thing))
    except (NameError, TypeError):
        return {}


def _classes_in(hint: Any) -> Iterator[type]:
    if inspect.isclass(hint) and not typing.get_args(hint):
        yield hint
    for part in typing.get_args(hint):
        yield from _classes_in(part)


def _section_of(module: str) -> str:
    inner = module.removeprefix("posefuse.")
    matching = {
        prefix: title for title, prefixes in _SECTIONS.items() for prefix in prefixes if inner.startswith(prefix)
    }
    return matching[max(matching, key=len)]


def write_pages(app: Sphinx) -> None:
    """Write the index and the pages; pages that have not changed keep their time."""
    folder = Path(app.srcdir) / "generated" / "api"
    folder.mkdir(parents=True, exist_ok=True)
    sections: dict[str, list[str]] = {title: [] for title in _SECTIONS}
    pages = {}
    for name, thing in public_names().items():
        sections[_section_of(thing.__module__)].append(name)
        pages[f"{name}.rst"] = _page(name, f"posefuse.{name}", thing)
    others = []
    for kind in returned_types():
        # A second type of the same name is qualified by its module.
        stem = kind.__name__ if f"{kind.__name__}.rst" not in pages else f"{kind.__module__}.{kind.__name__}"
        pages[f"{stem}.rst"] = _page(kind.__name__, f"{kind.__module__}.{kind.__qualname__}", kind)
        others.append(stem)
    pages["index.rst"] = _index({**sections, "Returned types": others})
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")
    for path in folder.glob("*.rst"):
        if path.name not in pages:
            path.unlink()


def _page(title: str, place: str, thing: Any) -> str:
    kind = "function" if not inspect.isclass(thing) else "exception" if issubclass(thing, BaseException) else "class"
    members = {"function": "", "exception": "", "class": "   :members:\n"}[kind]
    if inspect.isclass(thing) and issubclass(thing, Enum):
        members = "   :members:\n   :undoc-members:\n"
    return f"{title}\n{'=' * len(title)}\n\n.. auto{kind}:: {place}\n{members}"


def _index(sections: dict[str, list[str]]) -> str:
    text = [
        "API", "===", "",
        "``import posefuse`` gives these names. The last section lists the types that they return. Array axes,",
        "units and missing values follow the :doc:`conventions </conventions>`.", "",
    ]  # fmt: skip
    for title, names in sections.items():
        text += [title, "-" * len(title), "", ".. list-table::", "   :widths: 30 70", ""]
        for name in names:
            text += [f"   * - :doc:`{name.rpartition('.')[2]} <{name}>`", f"     - {_first_sentence(name)}"]
        text += ["", ".. toctree::", "   :hidden:", "", *(f"   {name}" for name in names), ""]
    return "\n".join(text)


def _first_sentence(name: str) -> str:
    thing = public_names().get(name) or next(
        kind for kind in returned_types() if name in (kind.__name__, f"{kind.__module__}.{kind.__name__}")
    )
    paragraph = " ".join((inspect.getdoc(thing) or "").split("\n\n")[0].split())
    # The table quotes code; references would need the page's own context.
    paragraph = re.sub(r":\w+:`~?\.?([^`]+)`", r"``\1``", paragraph)
    return paragraph.replace("*", r"\*")


def add_attribute_types(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Add the types of a record's fields to the section ``Attributes`` of its docstring, before napoleon reads it."""
    if what == "property" and lines:
        lines[:0] = ["..", ""]  # Napoleon takes what precedes a colon in the first line for a type.
    if what != "class" or not is_dataclass(obj):
        return
    hints = _hints(obj)
    types = {f.name: _short(hints.get(f.name, f.type)) for f in fields(obj) if hints.get(f.name, f.type)}
    inside = False
    for number, line in enumerate(lines):
        if line and not line.startswith(" "):
            inside = line.strip() == "Attributes:"
        match = re.match(r"    (\w+): ", line)
        if inside and match and match[1] in types:
            lines[number] = f"    {match[1]} (``{types[match[1]]}``): {line[match.end() :]}"


def shorten_defaults(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, signature: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    """Replace defaults that are not Python, such as ``<factory>``, by an ellipsis."""
    return (re.sub(r"<[^<>]*>", "...", signature) if signature else signature), returns


def _short(hint: Any) -> str:
    return re.sub(r"\b(?:[a-z_]\w*\.)+(?=[A-Za-z])", "", stringify_annotation(hint))


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the pages."""
    app.connect("builder-inited", write_pages, priority=400)
    app.connect("autodoc-process-signature", shorten_defaults)
    app.connect("autodoc-process-docstring", add_attribute_types, priority=400)
    return {"parallel_read_safe": True}
