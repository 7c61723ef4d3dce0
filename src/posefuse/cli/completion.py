"""Scripts by which bash, zsh and fish complete commands, options and choices; ``posefuse --completion bash``.

Options of groups, such as ``--tracker.gate``, are left out: scripts that hold them slow down the start of a shell.
"""

from collections.abc import Iterator, Mapping
from shlex import quote

from cyclopts import App

_FUNCTION = """_posefuse() {
    local word="${COMP_WORDS[COMP_CWORD]}" before="${COMP_WORDS[COMP_CWORD-1]}" choices=""
    COMPREPLY=()
    if [[ $COMP_CWORD -eq 1 ]]; then
        COMPREPLY=($(compgen -W %s -- "$word"))
        return
    fi
    case "${COMP_WORDS[1]} $before" in
%s
    esac
    if [[ -z $choices && $word == -* ]]; then
        case "${COMP_WORDS[1]}" in
%s
        esac
    fi
    [[ -z $choices ]] || COMPREPLY=($(compgen -W "$choices" -- "$word"))
}
complete -o default -F _posefuse posefuse"""
_ZSH = "autoload -U +X bashcompinit && bashcompinit\n"
"""Zsh runs functions that are written for bash."""


def completion_script(app: App, commands: Mapping[str, str], shell: str) -> str:
    """Return the script of a shell.

    Args:
        app: the command line.
        commands: help of each command by name.
        shell: one of ``bash``, ``zsh`` and ``fish``.
    """
    options = {name: dict(_options(app[name])) for name in commands}
    if shell == "fish":
        return "\n".join(_fish(commands, options))
    choices = [
        f"        {quote(f'{command} {name}')}) choices={quote(' '.join(values))} ;;"
        for command, names in options.items()
        for name, values in names.items()
        if values
    ]
    names = [f"            {command}) choices={quote(' '.join(names))} ;;" for command, names in options.items()]
    script = _FUNCTION % (quote(" ".join(commands)), "\n".join(choices), "\n".join(names))
    return _ZSH + script if shell == "zsh" else script


def _options(command: App) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the options of a command and their choices."""
    for argument in command.assemble_argument_collection(parse_docstring=False):
        name = argument.names[0]
        if argument.show and name.startswith("--") and "." not in name:
            yield name, argument.get_choices() or ()


def _fish(commands: Mapping[str, str], options: Mapping[str, Mapping[str, tuple[str, ...]]]) -> Iterator[str]:
    """Yield the lines of the script for fish."""
    for command, text in commands.items():
        yield f"complete -c posefuse -n __fish_use_subcommand -a {command} -d {quote(text)}"
    for command, names in options.items():
        for name, values in names.items():
            given = f" -x -a {quote(' '.join(values))}" if values else ""
            yield f"complete -c posefuse -n '__fish_seen_subcommand_from {command}' -l {name[2:]}{given}"
