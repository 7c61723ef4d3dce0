"""XML documents of OpenSim."""

from pathlib import Path
from xml.etree import ElementTree

from posefuse.io.files import replacing

_VERSION = "40500"


def document() -> ElementTree.Element:
    """Return the root of a new document."""
    return ElementTree.Element("OpenSimDocument", Version=_VERSION)


def add(parent: ElementTree.Element, tag: str, text: str | None = None, **attributes: str) -> ElementTree.Element:
    """Add an element and return it."""
    child = ElementTree.SubElement(parent, tag, attributes)
    child.text = text
    return child


def add_objects(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    """Add a set and return its list of objects."""
    return add(add(parent, tag, **attributes), "objects")


def write_document(root: ElementTree.Element, path: Path) -> None:
    """Write a document.

    Raises:
        FileError: if the file cannot be written.
    """
    ElementTree.indent(root)
    with replacing(path) as temporary:
        text = ElementTree.tostring(root, encoding="unicode")
        temporary.write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n', "utf-8")
