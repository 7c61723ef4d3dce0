"""The command that makes a result again, with the options that differ from the defaults."""

import dataclasses
from html import escape
from typing import Any

import tomli_w

from posefuse.model.options.options import Options
from posefuse.model.reconstruction import Reconstruction
from posefuse.skeleton.skeletons import shipped_skeletons


def command_box(result: Reconstruction) -> str:
    """Return the command as HTML, with a button that copies it."""
    file = _skeleton_file(result.options)
    skeleton = f" <code>{escape(file)}</code> is the file of the skeleton." if file else ""
    return (
        "<p>The same result from the same files: RECORDING is the folder of the recording, OUTPUT a new folder. Where "
        "a folder holds several calibrations or keypoint sets, name them with <code>--calibration</code> and "
        f'<code>--keypoints</code>.{skeleton}</p><div class="command"><pre id="command" tabindex="0" role="region" '
        f'aria-label="Command">{escape(repeating_command(result.options))}</pre>'
        '<button id="copy" type="button" data-copy="command">Copy</button></div>'
    )


def repeating_command(options: Options) -> str:
    """Return the lines for a shell that reconstruct with these options."""
    options = dataclasses.replace(options, skeleton=_skeleton_file(options) or options.skeleton)
    changed = _changed(dataclasses.asdict(options), dataclasses.asdict(Options()))
    if not changed:
        return "posefuse reconstruct RECORDING --output OUTPUT"
    return (
        f"cat > options.toml <<'END'\n{tomli_w.dumps(changed)}END\n"
        "posefuse reconstruct RECORDING --options options.toml --output OUTPUT"
    )


def _skeleton_file(options: Options) -> str:
    """Return a name for the file of a skeleton that is not built in; empty for one that is, and without one."""
    # Results store the name of the skeleton, because the path of its file differs between machines.
    name = options.skeleton
    return "" if name is None or name in shipped_skeletons() or name.endswith(".toml") else f"{name}.toml"


def _changed(values: dict[str, Any], defaults: dict[str, Any]) -> dict[str, Any]:
    """Return the values that differ from the defaults, as tables within tables."""
    out: dict[str, Any] = {}
    for name, value in values.items():
        default = defaults.get(name)
        if isinstance(value, dict) and isinstance(default, dict):
            if inner := _changed(value, default):
                out[name] = inner
        elif value is not None and value != default:
            out[name] = value
    return out
