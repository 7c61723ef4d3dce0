"""The optional dependency that draws figures (extra ``plot``), and colors that figures and the report share."""

from importlib.util import find_spec

from posefuse.errors import ResultError

# Colors of Okabe and Ito: distinguishable with color vision deficiency, and by lightness in print.
BLUE = "#0072b2"
ORANGE = "#d55e00"

WITHOUT_FIGURES = "No figures were drawn: they need matplotlib. Run: pip install 'posefuse[plot]'."


def has_matplotlib() -> bool:
    """Return whether figures can be drawn."""
    return find_spec("matplotlib") is not None


def require_matplotlib() -> None:
    """Check that figures can be drawn.

    Raises:
        ResultError: if matplotlib is not installed.
    """
    if not has_matplotlib():
        raise ResultError("Figures need matplotlib, which is not installed. Run: pip install 'posefuse[plot]'.")
