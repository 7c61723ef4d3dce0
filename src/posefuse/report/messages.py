"""Messages, notes and findings as HTML."""

from html import escape

from posefuse.model.options.flags import as_flags

_START, _END = "\x00", "\x01"


def message_html(text: str) -> str:
    """Return a message as HTML; options and functions that it names are set as the flags and commands of a shell."""
    marked = as_flags(text, lambda flag: f"{_START}{flag}{_END}")
    return escape(marked).replace(_START, "<code>").replace(_END, "</code>")
