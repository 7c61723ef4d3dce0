"""Add compiled kernels to a wheel, if ``scripts/build_wheel.py`` builds it."""

import os
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class KernelsHook(BuildHookInterface):
    """Build hook of hatchling."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the kernels in the folder ``POSEFUSE_KERNELS``; without that variable, the wheel is for all systems."""
        folder = os.environ.get("POSEFUSE_KERNELS")
        if folder and version != "editable":
            if not list(Path(folder).glob("*.nbi")):
                raise FileNotFoundError(f"{folder} contains no compiled kernels.")
            build_data["pure_python"] = False
            build_data["tag"] = os.environ["POSEFUSE_WHEEL_TAG"]
            build_data["force_include"][folder] = "posefuse/kernels/machine_code"
