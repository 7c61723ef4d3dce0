"""Refuse options of the other kind of calibration."""

from dataclasses import fields

from posefuse.errors import OptionsError
from posefuse.model.options.calibration import CalibrateOptions, PeopleOptions


def refuse_options(missing: str | None, **given: object) -> None:
    """Raise an error that names an argument, or an option, of the other kind of calibration."""
    names = [_first_change(name, value) for name, value in given.items() if value is not None]
    if names and missing:
        raise OptionsError(f"`{names[0]}` is for calibrations by a board. Set `{missing}`, or remove `{names[0]}`.")
    if names:
        raise OptionsError(f"`{names[0]}` is for calibrations by people. Remove `board`, or remove `{names[0]}`.")


def _first_change(name: str, value: object) -> str:
    """Return the name of the first option that differs from its default, or of the argument."""
    if not isinstance(value, CalibrateOptions | PeopleOptions):
        return name
    usual = type(value)()
    changed = [each.name for each in fields(value) if getattr(value, each.name) != getattr(usual, each.name)]
    return changed[0] if changed else name
