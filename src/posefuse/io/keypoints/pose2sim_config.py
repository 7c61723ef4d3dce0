"""Settings of Pose2Sim beside keypoints, in ``Config.toml``: frame rate and pose model."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from posefuse.io.files import read_toml
from posefuse.skeleton.skeletons import Skeleton, shipped_skeleton

_MODELS = {
    "body_with_feet": "halpe_26",
    "halpe_26": "halpe_26",
    "body": "coco_17",
    "coco_17": "coco_17",
    "whole_body": "coco_wholebody_133",
    "coco_133": "coco_wholebody_133",
    "body_25": "body_25",
    "body_25b": "body_25b",
    "blazepose": "mediapipe_33",
}


@dataclass(frozen=True)
class TrialSettings:
    """Settings of a trial.

    Attributes:
        rate_hz: Frame rate, or None if it is not set.
        skeleton: Skeleton of the pose model, or None if it is not set or unknown.
    """

    rate_hz: float | None
    skeleton: Skeleton | None


def find_settings(folder: Path) -> TrialSettings:
    """Return the settings of the trial to which a folder belongs.

    As in Pose2Sim, a level without a setting inherits it from the level above, up to three levels.

    Raises:
        FileError: If a ``Config.toml`` is not valid TOML.
    """
    rate: float | None = None
    skeleton: Skeleton | None = None
    for level in (folder, *list(folder.resolve().parents)[:3]):
        path = level / "Config.toml"
        if not path.is_file():
            continue
        data = read_toml(path)
        rate = rate or _rate(data.get("project", {}))
        skeleton = skeleton or _skeleton(data.get("pose", {}))
    return TrialSettings(rate, skeleton)


def _rate(project: Any) -> float | None:
    value = project.get("frame_rate") if isinstance(project, dict) else None
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) and value > 0 else None


def _skeleton(pose: Any) -> Skeleton | None:
    model = pose.get("pose_model") if isinstance(pose, dict) else None
    name = _MODELS.get(model.lower()) if isinstance(model, str) else None
    return shipped_skeleton(name) if name else None
