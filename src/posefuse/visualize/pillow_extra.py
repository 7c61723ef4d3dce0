"""The optional dependencies that resize images and write text on them (extra ``video``)."""

from importlib.util import find_spec

from posefuse.errors import ResultError


def require_pillow() -> None:
    """Check that images can be drawn on.

    Raises:
        ResultError: if Pillow or matplotlib, which contains the font, is not installed.
    """
    if missing := [name for module, name in (("PIL", "Pillow"), ("matplotlib", "matplotlib")) if not find_spec(module)]:
        verb = "is" if len(missing) == 1 else "are"
        raise ResultError(
            f"Pictures of people need {' and '.join(missing)}, which {verb} not installed. Run: "
            "pip install 'posefuse[video]'."
        )
