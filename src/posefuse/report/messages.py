"""Messages, notes and findings as HTML."""

import re
from html import escape

_NAMED = re.compile(r"(?<!`)`([a-z][a-z0-9_.]*(?:=[^`]*)?)`(?!`)")


def message_html(text: str) -> str:
    """Return a message as HTML; what it names in backticks, such as options, is set as code."""
    return _NAMED.sub(r"<code>\1</code>", escape(text))
