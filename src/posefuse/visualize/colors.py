"""Colours of people and marks, told apart by colour-blind people (Okabe and Ito)."""

Colour = tuple[int, int, int]

PEOPLE: tuple[Colour, ...] = (
    (86, 180, 233), (230, 159, 0), (0, 190, 140), (204, 121, 167), (240, 228, 66), (0, 114, 178), (213, 94, 0),
)  # fmt: skip
REJECTED: Colour = (255, 70, 70)
NOBODY: Colour = (170, 170, 170)
INK: Colour = (0, 0, 0)
PAPER: Colour = (255, 255, 255)
BACKGROUND: Colour = (28, 30, 34)


def colour_of(person: int) -> Colour:
    """The colour of a person by their place in the result; with more than seven, colours come again."""
    return PEOPLE[person % len(PEOPLE)]
