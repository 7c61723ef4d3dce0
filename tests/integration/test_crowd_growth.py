"""Cost of a frame in a crowd, counted in calls and comparisons, which do not depend on the machine."""

import importlib
import pkgutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from types import FrameType
from typing import Any

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

import posefuse.tracking
from posefuse.model.frames import Frame
from posefuse.model.options.options import Options
from posefuse.model.tracks import TrackState
from posefuse.pipeline.people.initial_noise import default_noise
from posefuse.pipeline.people.trackers import tracker_of
from posefuse.synthetic.crowd_options import NO_FAULTS, CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from posefuse.synthetic.options import CLEAN

VIEWS, RATE_HZ, SECONDS, CONFIRMED_S = 6, 25.0, 3.0, 2.0
SIZES = (4, 8, 16)


@dataclass(frozen=True)
class Counts:
    """Medians over the frames after everybody was confirmed.

    Attributes:
        kernel_calls: by kernel.
        python_calls: number of calls of Python functions.
        compared: pairs of people and detections whose keypoints were compared.
        pairs: all pairs.
    """

    kernel_calls: Counter[str]
    python_calls: float
    compared: float
    pairs: float


def tracking_modules() -> list[Any]:
    """Return all modules of the tracker."""
    names = [each.name for each in pkgutil.walk_packages(posefuse.tracking.__path__, "posefuse.tracking.")]
    return [importlib.import_module(name) for name in names]


@contextmanager
def counted_kernels(calls: Counter[str], results: dict[str, list[Any]]) -> Iterator[None]:
    """Count the calls of kernels from the tracker and keep what they return."""

    def counting(name: str, kernel: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any) -> Any:
            calls[name] += 1
            result = kernel(*args)
            results.setdefault(name, []).append(result)
            return result

        return call

    with pytest.MonkeyPatch.context() as patch:
        for module in tracking_modules():
            for name, value in list(vars(module).items()):
                if isinstance(value, Dispatcher):
                    patch.setattr(module, name, counting(name, value))
        yield


@cache
def counts_of(people: int) -> Counts:
    """Track a crowd that everybody can see, and count."""
    options = CrowdOptions(
        "ten", people=people, cameras=VIEWS, duration_s=SECONDS, rate_hz=RATE_HZ, skeleton="coco_17", detector=CLEAN,
        faults=NO_FAULTS,
    )  # fmt: skip
    scene = simulate_crowd(options)
    skeleton = scene.detections.skeleton
    live = tracker_of(scene.rig, skeleton, default_noise(scene.rig, Options()), Options())
    kernel_calls: list[Counter[str]] = []
    python_calls, compared, pairs = [], [], []
    first = round(CONFIRMED_S * RATE_HZ)
    for i in range(scene.detections.n_frames):
        frame = Frame.of(scene.detections, i)
        if i < first:
            live.update(frame)
            continue
        n_tracks, calls, results = len(live.tracks), Counter[str](), {}
        with counted_kernels(calls, results):
            python_calls.append(count_python_calls(lambda frame=frame: live.update(frame)))
        kernel_calls.append(calls)
        compared.append(results["score_detections"][0])
        pairs.append(n_tracks * len(frame.view))
    assert sum(track.state == TrackState.ACTIVE for track in live.tracks) >= people // 2
    names = {name for calls in kernel_calls for name in calls}
    medians = Counter({name: int(np.median([calls[name] for calls in kernel_calls])) for name in names})
    return Counts(medians, float(np.median(python_calls)), float(np.median(compared)), float(np.median(pairs)))


def count_python_calls(function: Callable[[], Any]) -> int:
    """Return the number of Python functions that are called."""
    n = 0

    def profile(_: FrameType, event: str, __: Any) -> None:
        nonlocal n
        n += event == "call"

    before = sys.getprofile()
    sys.setprofile(profile)
    try:
        function()
    finally:
        sys.setprofile(before)
    return n


def test_kernels_are_called_per_frame_and_not_per_person():
    """All people of a stage share one call."""
    assert all(counts_of(people).kernel_calls == counts_of(SIZES[0]).kernel_calls for people in SIZES)


def test_python_grows_at_most_linearly_with_people():
    few, some, many = (counts_of(people).python_calls for people in SIZES)
    per_person = (many - some) / (SIZES[2] - SIZES[1])
    assert per_person <= 1.2 * (some - few) / (SIZES[1] - SIZES[0])
    assert per_person <= 50


def test_compared_pairs_grow_at_most_linearly_with_people():
    """Pairs grow with the square; few of them are near enough in the image to be compared keypoint by keypoint."""
    some, many = (counts_of(people) for people in SIZES[1:])
    growth = (SIZES[2] / SIZES[1]) ** 1.25
    assert many.compared <= growth * some.compared
    assert many.pairs > 1.5 * growth * some.pairs
    assert many.compared <= 4 * SIZES[2] * VIEWS
