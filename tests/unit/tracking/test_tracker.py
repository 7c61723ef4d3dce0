"""Order and options of the tracker's stages."""

from collections.abc import Callable
from dataclasses import fields

import pytest

from posefuse.model.options.tracker import TrackerOptions
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import CrowdScene, simulate_crowd
from tests.unit.tracking.stage_runs import run_without

STAGES = {
    "fast_motion": ("posefuse.tracking.associate.assign_fast_motion",),
    "partial_detections": ("posefuse.tracking.associate.merge_partial_detections",),
    "shared_detections": ("posefuse.tracking.associate.share_between_tracks",),
    "single_view": (
        "posefuse.tracking.update.apply_posture_prior",
        "posefuse.tracking.update.apply_height_prior",
        "posefuse.tracking.update.observe_posture",
        "posefuse.tracking.update.observe_height",
    ),
    "reinitialization": (
        "posefuse.tracking.update.is_long_gap",
        "posefuse.tracking.update._reinitialize_displaced_limbs",
    ),
    "camera_monitor": ("posefuse.tracking.manage._monitor_cameras",),
    "identity_audit": ("posefuse.tracking.manage._audit",),
}
FRAMES = 30


@pytest.fixture(scope="module")
def scene() -> CrowdScene:
    return simulate_crowd(CrowdOptions(people=2, duration_s=FRAMES / 25.0, seed=3))


def count_calls(monkeypatch: pytest.MonkeyPatch, name: str, calls: list[str]) -> None:
    """Append the full name of a function to ``calls`` whenever it is called."""
    module, function = name.rsplit(".", 1)
    original: Callable[..., object] = getattr(__import__(module, fromlist=[function]), function)

    def wrapper(*args: object, **kwargs: object) -> object:
        calls.append(name)
        return original(*args, **kwargs)

    monkeypatch.setattr(name, wrapper)


@pytest.mark.parametrize("stage", STAGES)
def test_disabled_stage_is_not_called(stage: str, scene: CrowdScene, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    for functions in STAGES.values():
        for name in functions:
            count_calls(monkeypatch, name, calls)
    run_without(scene, stage)
    expected = {name for other, functions in STAGES.items() if other != stage for name in functions}
    assert set(calls) == expected


def test_stages_are_those_with_the_option_enabled() -> None:
    options = TrackerOptions()
    optional = {field.name for field in fields(options) if hasattr(getattr(options, field.name), "enabled")}
    assert optional == set(STAGES)
