"""Which stages of a run are finished, and of what inputs: the file ``run.json`` in the output."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from posefuse.io.checkpoints import digest_of
from posefuse.io.files import RUN_FILE, replacing


@dataclass
class RunState:
    """Digests of what each finished stage depends on.

    A stage runs again if its inputs, options or version change, or if its output is gone. An output that was edited by
    hand stays, and the stages after it run again.

    Attributes:
        output: folder of the run.
        keys: digest of each finished stage, by its name.
    """

    output: Path
    keys: dict[str, str] = field(default_factory=dict)

    @classmethod
    def read(cls, output: Path) -> "RunState":
        """Return the state of an output; without a readable file, no stage is finished."""
        try:
            keys = json.loads((output / RUN_FILE).read_text("utf-8"))["stages"]
            return cls(output, {str(name): str(key) for name, key in keys.items()})
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            return cls(output)

    def is_finished(self, stage: str, key: str) -> bool:
        """Return whether a stage was finished with these inputs."""
        return self.keys.get(stage) == key

    def finish(self, stage: str, key: str) -> None:
        """Store that a stage is finished."""
        self.keys[stage] = key
        self.write()

    def write(self) -> None:
        """Write the file, by which the folder is recognized as the output of a run."""
        with replacing(self.output / RUN_FILE) as temporary:
            temporary.write_text(json.dumps({"stages": self.keys}, indent=1, sort_keys=True) + "\n", "utf-8")


def stage_key(values: Mapping[str, Any]) -> str:
    """Return the digest of what a stage depends on, given as JSON values, and of the version."""
    return digest_of({**values, "posefuse": version("posefuse")})
