"""Manual corrections of identities in a result."""

from dataclasses import dataclass

from posefuse.errors import EditError

_NOT_IN_FILE_NAMES = frozenset('/\\:*?"<>|')


@dataclass(frozen=True)
class Merge:
    """Merge two names of one person.

    Attributes:
        person: name that is removed.
        into: name that is kept.
        keep: name whose data are kept where both are active; without it such frames are an error.
    """

    person: str
    into: str
    keep: str | None = None

    def __post_init__(self) -> None:
        if self.person == self.into:
            raise EditError(f"merge needs two different names; person and into are both {self.person!r}.")
        if self.keep not in (None, self.person, self.into):
            raise EditError(f"keep must be {self.person!r} or {self.into!r}, got {self.keep!r}.")

    @property
    def sentence(self) -> str:
        """Description of the edit."""
        chosen = "" if self.keep is None else f", {self.keep} where both were active"
        return f"{self.person} merged into {self.into}{chosen}"


@dataclass(frozen=True)
class Split:
    """Split one name of two people.

    Attributes:
        person: name; it keeps the earlier frames.
        into: new name of the later frames.
        from_frame: number of the first later frame.
    """

    person: str
    into: str
    from_frame: int

    def __post_init__(self) -> None:
        check_name(self.into)

    @property
    def sentence(self) -> str:
        """Description of the edit."""
        return f"{self.person} split; {self.into} from frame {self.from_frame} on"


@dataclass(frozen=True)
class Rename:
    """Rename a person.

    Attributes:
        person: old name.
        to: new name.
    """

    person: str
    to: str

    def __post_init__(self) -> None:
        check_name(self.to)

    @property
    def sentence(self) -> str:
        """Description of the edit."""
        return f"{self.person} renamed to {self.to}"


@dataclass(frozen=True)
class Drop:
    """Remove a person, completely or in a range of frames.

    Attributes:
        person: name; None removes everyone and needs a range.
        from_frame: number of the first frame; None starts at the beginning.
        to_frame: number of the last frame; None ends at the end.
    """

    person: str | None = None
    from_frame: int | None = None
    to_frame: int | None = None

    def __post_init__(self) -> None:
        if self.person is None and self.from_frame is None and self.to_frame is None:
            raise EditError("drop needs at least one of person, from_frame and to_frame.")
        if self.from_frame is not None and self.to_frame is not None and self.to_frame < self.from_frame:
            raise EditError(f"to_frame ({self.to_frame}) is before from_frame ({self.from_frame}).")

    @property
    def whole(self) -> bool:
        """Whether the edit covers all frames."""
        return self.from_frame is None and self.to_frame is None

    @property
    def sentence(self) -> str:
        """Description of the edit."""
        first = "" if self.from_frame is None else f" from frame {self.from_frame}"
        last = "" if self.to_frame is None else f" to frame {self.to_frame}"
        return f"{self.person or 'everyone'} dropped{first}{last}"


@dataclass(frozen=True)
class Swap:
    """Swap the names of two people.

    Attributes:
        people: two names.
        from_frame: number of the first frame with wrong names.
    """

    people: tuple[str, str]
    from_frame: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "people", tuple(self.people))
        if len(self.people) != 2 or self.people[0] == self.people[1]:
            raise EditError(f"swap needs two different names in people, got {list(self.people)}.")

    @property
    def sentence(self) -> str:
        """Description of the edit."""
        return f"{self.people[0]} and {self.people[1]} swapped from frame {self.from_frame} on"


Edit = Merge | Split | Rename | Drop | Swap
EDITS: dict[str, type[Edit]] = {"merge": Merge, "split": Split, "rename": Rename, "drop": Drop, "swap": Swap}


def name_of(edit: Edit) -> str:
    """Return the name of an edit in files and messages."""
    return type(edit).__name__.lower()


def check_name(name: str) -> None:
    """Check that a name can be part of a file name.

    Raises:
        EditError: if it cannot.
    """
    wrong = sorted({character for character in name if character in _NOT_IN_FILE_NAMES or not character.isprintable()})
    if wrong:
        raise EditError(f"{name!r} cannot be the name of a person: it is part of file names and contains {wrong[0]!r}.")
    if not name or name != name.strip() or name.startswith("."):
        raise EditError(
            f"{name!r} cannot be the name of a person: names must not be empty, start with a dot, or start or end "
            "with a space."
        )
