"""Describe wrong calls of the command line, in the words of the options record."""

import types
from collections.abc import Iterable
from typing import Any, Literal, Union, get_args, get_origin

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
        return _wrong_value(error, error.token.keyword, error.token.value)
    return str(error).strip()


def _wrong_value(error: CoercionError, flag: str, value: str) -> str:
    """Return what the value of a flag must be: of the option, or of the type that the command declares."""
    hint = None if error.argument is None else error.argument.hint
    option = _option(flag)
    if option is not None and hint in (None, option.hint):
        return f"{flag} must be {option.expected}, got {value!r}.{_did_you_mean(value, option)}"
    expected = None if hint is None else _expected(hint)
    return str(error).strip() if expected is None else f"{flag} must be {expected}, got {value!r}."


def _expected(hint: Any) -> str | None:
    """Return what the values of a type are, or None for a type whose errors the parser describes."""
    if hint in (int, float):
        return "an integer" if hint is int else "a number"
    if get_origin(hint) is Literal:
        return f"one of {choices(get_args(hint))}" if len(get_args(hint)) > 1 else repr(get_args(hint)[0])
    if get_origin(hint) in (Union, types.UnionType):
        inner = [_expected(each) for each in get_args(hint) if each is not type(None)]
        return None if None in inner else " or ".join(filter(None, inner))
    return None


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
    missing = f"{name} is missing. posefuse {command} --help describes it."
    unknown = [token.partition("=")[0] for token in error.unused_tokens or () if token.startswith("--")]
    if not unknown:
        return missing
    meant = suggestion(unknown[0], [name])
    return f"Unknown option: {unknown[0]}. {meant}" if meant.startswith("Did you mean") else missing


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
