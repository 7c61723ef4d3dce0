"""Colors of people and marks that color-blind people can distinguish (Okabe and Ito)."""

Color = tuple[int, int, int]

PEOPLE: tuple[Color, ...] = (
    (86, 180, 233), (230, 159, 0), (0, 190, 140), (204, 121, 167), (240, 228, 66), (0, 114, 178), (213, 94, 0),
)  # fmt: skip
REJECTED: Color = (255, 70, 70)
UNASSIGNED: Color = (170, 170, 170)
INK: Color = (0, 0, 0)
PAPER: Color = (255, 255, 255)
BACKGROUND: Color = (28, 30, 34)


def person_color(person: int) -> Color:
    """Return the color of a person by index in the result; colors repeat after seven people."""
    return PEOPLE[person % len(PEOPLE)]
