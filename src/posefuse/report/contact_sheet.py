"""The contact sheet: one page with pictures of every person and the name that selects the person."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from posefuse.report.page import document


@dataclass(frozen=True)
class PersonPicture:
    """A picture of a person.

    Attributes:
        caption: camera and time.
        jpeg: content of the JPEG file.
        size_px: its width and height.
    """

    caption: str
    jpeg: bytes
    size_px: tuple[int, int]


@dataclass(frozen=True)
class PersonCard:
    """What the contact sheet shows of a person.

    Attributes:
        name: name of the person.
        presence: when the person is there, in words.
        pictures: pictures, the best first.
    """

    name: str
    presence: str
    pictures: tuple[PersonPicture, ...]


def render_contact_sheet(cards: Sequence[PersonCard], notes: Sequence[str] = ()) -> str:
    """Return the contact sheet as the text of an HTML file that needs no network.

    Args:
        cards: the people, in the order of the result.
        notes: sentences for the reader.
    """
    count = "1 person" if len(cards) == 1 else f"{len(cards)} people"
    return document(
        "people.html",
        title=escape(f"posefuse: {count}"),
        css=("people.css",),
        notes="".join(f"<p>{escape(note)}</p>" for note in notes),
        cards="\n".join(_card(card) for card in cards) or "<p>No person was found.</p>",
    )


def _card(card: PersonCard) -> str:
    pictures = "".join(_picture(card.name, picture) for picture in card.pictures)
    shown = pictures or "<p>No image shows this person well.</p>"
    name = escape(card.name)
    return (
        f'<section class="card"><h2>{name}</h2><p>{escape(card.presence)}</p><div class="pictures">{shown}</div>'
        f"<p><code>--person {name}</code></p></section>"
    )


def _picture(name: str, picture: PersonPicture) -> str:
    data = base64.b64encode(picture.jpeg).decode("ascii")
    width, height = picture.size_px
    return (
        f'<figure><img src="data:image/jpeg;base64,{data}" width="{width}" height="{height}" '
        f'alt="{escape(name)} in {escape(picture.caption)}"><figcaption>{escape(picture.caption)}</figcaption></figure>'
    )
