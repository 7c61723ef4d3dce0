"""Describe wrong calls of the command line, in the words of the options record."""

from collections.abc import Iterable

from cyclopts.exceptions import (
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    UnknownOptionError,
    UnusedCliTokensError,
)

from posefuse.errors import choices, suggestion
from posefuse.model.options.aliases import matching_option
from posefuse.model.options.bounds import valid_choices
from posefuse.model.options.catalog import OptionEntry, options_by_name


def describe(error: CycloptsError) -> str:
    """Return what is wrong with a call, what is valid, and what was probably meant."""
    if isinstance(error, UnknownOptionError):
        return _unknown_flag(error)
    if isinstance(error, UnusedCliTokensError) and error.unused_tokens:
        return _unexpected(error.unused_tokens, " ".join(error.command_chain or ()))
    if type(error) is MissingArgumentError and error.argument is not None and not error.argument.tokens:
        missing = _missing(error)
        if missing is not None:
            return missing
    if isinstance(error, CoercionError) and error.token is not None and error.token.keyword:
        option = _option(error.token.keyword)
        if option is not None:
            value = error.token.value
            return f"{error.token.keyword} must be {option.expected}, got {value!r}.{_did_you_mean(value, option)}"
    return str(error).strip()


def _unexpected(tokens: Iterable[str], command: str) -> str:
    names = choices(repr(token) for token in tokens)
    return f"Unexpected: {names}. posefuse {command} --help lists what the command takes."


def _missing(error: MissingArgumentError) -> str | None:
    """Return which argument is not given, or None if its flag is given without a value."""
    assert error.argument is not None
    if error.keyword is not None:
        return None
    name, command = error.argument.name, " ".join(error.command_chain or ())
    if error.argument.field_info.is_positional:
        name = name.lstrip("-").upper()  # as help names it
    return f"{name} is missing. posefuse {command} --help describes it."


def _unknown_flag(error: UnknownOptionError) -> str:
    flag = (error.token.keyword or error.token.value).partition("=")[0]
    valid = [name for argument in error.argument_collection if argument.parse for name in argument.names]
    siblings = [name.removeprefix("--").replace("-", "_") for name in valid if name.startswith("--")]
    match = matching_option(flag, [name for name in siblings if "." not in name])
    if match is None or f"--{match.replace('_', '-')}" not in valid:
        return str(error).strip()
    return f"Unknown option: {flag}. Did you mean --{match.replace('_', '-')}?"


def _option(flag: str) -> OptionEntry | None:
    return options_by_name().get(flag.removeprefix("--").replace("-", "_"))


def _did_you_mean(value: str, option: OptionEntry) -> str:
    text = suggestion(value, valid_choices(option.hint, option.bounds))
    return f" {text}" if text.startswith("Did you mean") else ""
