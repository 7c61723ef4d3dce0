"""What a person who looked at a result wants put right: who is whom."""

from dataclasses import dataclass

from posefuse.errors import EditError

_NOT_IN_FILE_NAMES = frozenset('/\\:*?"<>|')


@dataclass(frozen=True)
class Merge:
    """Two names of one person become one.

    Attributes:
        person: the name that goes.
        into: the name that stays.
        keep: whose frames count where both are active; without it such frames are an error.
    """

    person: str
    into: str
    keep: str | None = None

    def __post_init__(self) -> None:
        if self.person == self.into:
            raise EditError(f"person and into are both {self.person!r}: nothing to merge.")
        if self.keep not in (None, self.person, self.into):
            raise EditError(f"keep is one of the two, {self.person!r} or {self.into!r}, got {self.keep!r}.")

    @property
    def sentence(self) -> str:
        """What was done."""
        chosen = "" if self.keep is None else f", {self.keep} where both were active"
        return f"{self.person} merged into {self.into}{chosen}"


@dataclass(frozen=True)
class Split:
    """Two people under one name become two.

    Attributes:
        person: the name; it stays with the earlier frames.
        into: the new name of the later ones.
        from_frame: number of the first of the later frames.
    """

    person: str
    into: str
    from_frame: int

    def __post_init__(self) -> None:
        check_name(self.into)

    @property
    def sentence(self) -> str:
        """What was done."""
        return f"{self.person} split, {self.into} from frame {self.from_frame} on"


@dataclass(frozen=True)
class Rename:
    """Another name for a person.

    Attributes:
        person: the old name.
        to: the new one.
    """

    person: str
    to: str

    def __post_init__(self) -> None:
        check_name(self.to)

    @property
    def sentence(self) -> str:
        """What was done."""
        return f"{self.person} renamed {self.to}"


@dataclass(frozen=True)
class Drop:
    """Somebody is taken out, altogether or in a range of frames.

    Attributes:
        person: who; without it everybody, and then a range must be given.
        from_frame: number of the first frame; without it from the beginning.
        to_frame: number of the last frame; without it to the end.
    """

    person: str | None = None
    from_frame: int | None = None
    to_frame: int | None = None

    def __post_init__(self) -> None:
        if self.person is None and self.from_frame is None and self.to_frame is None:
            raise EditError("drop needs a person, from_frame or to_frame, or several of them.")
        if self.from_frame is not None and self.to_frame is not None and self.to_frame < self.from_frame:
            raise EditError(f"to_frame ({self.to_frame}) comes before from_frame ({self.from_frame}).")

    @property
    def whole(self) -> bool:
        """Whether all frames are meant."""
        return self.from_frame is None and self.to_frame is None

    @property
    def sentence(self) -> str:
        """What was done."""
        first = "" if self.from_frame is None else f" from frame {self.from_frame}"
        last = "" if self.to_frame is None else f" to frame {self.to_frame}"
        return f"{self.person or 'everybody'} dropped{first}{last}"


@dataclass(frozen=True)
class Swap:
    """Two people who exchanged their names somewhere exchange them back.

    Attributes:
        people: the two names.
        from_frame: number of the first frame in which they are the wrong way round.
    """

    people: tuple[str, str]
    from_frame: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "people", tuple(self.people))
        if len(self.people) != 2 or self.people[0] == self.people[1]:
            raise EditError(f"people are two different names, got {list(self.people)}.")

    @property
    def sentence(self) -> str:
        """What was done."""
        return f"{self.people[0]} and {self.people[1]} exchanged from frame {self.from_frame} on"


Edit = Merge | Split | Rename | Drop | Swap
EDITS: dict[str, type[Edit]] = {"merge": Merge, "split": Split, "rename": Rename, "drop": Drop, "swap": Swap}


def name_of(edit: Edit) -> str:
    """What an edit is called in files and messages."""
    return type(edit).__name__.lower()


def check_name(name: str) -> None:
    """Refuse names that cannot be the stems of files.

    Raises:
        EditError: with what is wrong with it.
    """
    wrong = sorted({character for character in name if character in _NOT_IN_FILE_NAMES or not character.isprintable()})
    if wrong:
        raise EditError(f"{name!r} cannot name a person: files are called after people, and {wrong[0]!r} is in it.")
    if not name or name != name.strip() or name.startswith("."):
        raise EditError(f"{name!r} cannot name a person: a name begins and ends with a letter or number.")
