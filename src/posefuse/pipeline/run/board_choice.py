"""Choose the board of a run, and the images that show it: by options, names, settings, and a look into the images."""

from dataclasses import dataclass

from posefuse.errors import PosefuseError
from posefuse.io.board_images import ViewImages, find_images
from posefuse.io.board_look import BoardLook, look_for_board
from posefuse.io.board_specs import EXAMPLE, read_board_spec
from posefuse.io.session import Session, locate, place_of, relative
from posefuse.model.board import Board
from posefuse.model.options.run import RunOptions

_MOST_SETS = 3


@dataclass(frozen=True)
class BoardChoice:
    """What is known about the board of a run.

    Attributes:
        board: description of the board as text or path, or None.
        views: images of the board that several cameras see together; empty without any.
        lens_views: images of the board for the lens of each camera; empty without any.
        notes: what was found and is not used, with what is missing.
        problems: what is wrong with the description.
    """

    board: str | None
    views: tuple[ViewImages, ...] = ()
    lens_views: tuple[ViewImages, ...] = ()
    notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()


def is_of_board(views: tuple[ViewImages, ...]) -> bool:
    """Return whether images were taken of a board."""
    found = look_for_board(views)
    return found is not None and found.is_of_board


def choose_board(session: Session, run: RunOptions) -> BoardChoice:
    """Return the board of a run, its images, and what is missing.

    Args:
        session: the content of the folder.
        run: options as requested.
    """
    folder = session.folder
    spec = run.board
    if spec is None and session.board is not None:
        spec = relative(session.board, folder)
    lenses = session.lens_views if run.lens_images is None else _named(session, run.lens_images)
    if run.intrinsics is not None:
        lenses = ()
    if run.board_images is not None:
        views, found = _named(session, run.board_images), None
    else:
        views, found = _images_of_board(session)
    seen = found or (look_for_board(lenses) if lenses and not views else None)
    place = place_of(views or lenses, folder) if views or lenses else ""
    shown = "The videos show" if views is session.views or place == "." else f"{place} shows"
    if spec is None:
        return BoardChoice(None, notes=_missing(session, seen, shown))
    try:
        board = read_board_spec(str(locate(spec, folder)) if spec.endswith(".toml") else spec)
    except PosefuseError as error:
        return BoardChoice(spec, views, lenses, problems=(str(error),))
    if run.board is None and seen is not None and not seen.board.agrees_with(board):
        return BoardChoice(None, notes=(_contradiction(spec, board, seen, shown),))
    if found is not None or run.board_images is not None or session.board_views:
        return BoardChoice(spec, views, lenses)
    if run.board is not None:
        # Sampled images can miss a board that is shown for a short time.
        return BoardChoice(spec, () if lenses else session.views, lenses)
    note = f"{spec} describes the board {board}, but no sampled image of the videos shows a board."
    return BoardChoice(None, (), (), (note,)) if not lenses else BoardChoice(spec, (), lenses)


def _named(session: Session, text: str) -> tuple[ViewImages, ...]:
    """Return the images in a folder that the options name."""
    for views in (session.board_views, session.lens_views, *session.others, session.views):
        if views and place_of(views, session.folder) == text:
            return views
    return find_images(locate(text, session.folder))


def _images_of_board(session: Session) -> tuple[tuple[ViewImages, ...], BoardLook | None]:
    """Return the images that show a board, by their names or by a look at them, and what they show."""
    if session.board_views:
        return session.board_views, look_for_board(session.board_views)
    sets = [views for views in session.others if len(views) > 1][:_MOST_SETS]
    for views in sets:
        found = look_for_board(views)
        if found is not None and found.is_of_board:
            return views, found
    found = look_for_board(session.views) if len(session.views) > 1 else None
    # People carry a board through some of the images; patterns on one wall are not carried.
    if found is not None and len(found.views) > 1:
        return session.views, found
    return (), None


def _missing(session: Session, seen: BoardLook | None, shown: str) -> tuple[str, ...]:
    """Return what is missing to calibrate by a board, if there may be one."""
    if seen is not None:
        return (
            f"{shown} {_described(seen)}; the side of its {_cell(seen)} is unknown. To calibrate by it, add "
            f"`board='{seen.board.spec('30mm')}'` with the measured side.",
        )
    if session.board_views or session.lens_views:
        return (
            f"{place_of(session.board_views or session.lens_views, session.folder)} may show a board, but nothing "
            f"describes it. To calibrate by it, add `board='{EXAMPLE}'` with its kind and size.",
        )
    return ()


def _contradiction(spec: str, board: Board, seen: BoardLook, shown: str) -> str:
    return (
        f"{spec} describes the board {board}. {shown} {_described(seen)}. To calibrate by it, add "
        f"`board='{seen.board.spec('30mm')}'` with the measured side."
    )


def _described(seen: BoardLook) -> str:
    """Return the kind and size of a board in words."""
    board = seen.board
    unit = {"charuco": "squares", "checkerboard": "inner corners"}.get(board.kind, "markers")
    name = {"charuco": "a ChArUco board", "checkerboard": "a checkerboard"}.get(board.kind, f"an {board.kind} board")
    markers = f" ({board.dictionary})" if board.dictionary else ""
    return f"{name} of {board.columns} x {board.rows} {unit}{markers}"


def _cell(seen: BoardLook) -> str:
    return "squares" if seen.board.kind in ("charuco", "checkerboard") else "markers"
