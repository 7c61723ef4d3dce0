"""Random options: each draw is rejected by an error that names an option, or gives a sane result."""

import re
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest

import posefuse
from posefuse.association.one_subject import NO_PERSON
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.options.catalog import options_by_name
from posefuse.model.options.options import Options
from posefuse.model.tracks import TrackState
from posefuse.synthetic.crowd_options import CrowdOptions
from posefuse.synthetic.crowds import simulate_crowd
from tests.option_draws import drawn_options, with_values
from tests.statuses import assert_all_statuses_hold

# Options may contradict each other or have no effect; NumPy's warnings are errors.
pytestmark = pytest.mark.filterwarnings("ignore::posefuse.errors.PosefuseWarning")

FRAMES = 16
LIVE_SHARE = 0.25
BLOCK = 100


@cache
def recording(people: int) -> tuple[CameraRig, Detections]:
    """Return a recording of walking people."""
    options = CrowdOptions(people=people, cameras=3, duration_s=FRAMES / 25.0, seed=people, skeleton="body_20")
    scene = simulate_crowd(options)
    return scene.rig, scene.detections


def outcome(seed: int) -> str:
    """Run one draw; return whether it was accepted or rejected."""
    rng = np.random.default_rng(seed)
    people, live, values = int(rng.integers(1, 3)), rng.random() < LIVE_SHARE, drawn_options(rng)
    return outcome_of(values, people, live, f"seed {seed}")


def outcome_of(values: Mapping[str, Any], people: int, live: bool, case: str = "") -> str:
    """Run options by dotted name; return whether they were accepted or rejected."""
    try:
        options = with_values(values)
        (run_live if live else run_reconstruction)(options, people)
    except posefuse.PosefuseError as error:
        if not names_an_option(str(error), values):
            raise AssertionError(f"{case}: {values}: no option is named: {error}") from error
        return "rejected"
    except Exception as error:
        raise AssertionError(f"{case}: {values}: {error!r}") from error
    return "accepted"


def run_reconstruction(options: Options, people: int) -> None:
    """Reconstruct and check the result."""
    rig, detections = recording(people)
    result = posefuse.reconstruct(rig, detections, options)
    assert_all_statuses_hold(result)
    for layer in result.layers.values():
        points = layer.points_m[layer.has_point]
        assert not len(points) or np.abs(points).max() < 1e6
    state = np.asarray(result.tracks.state) if result.tracks is not None else np.empty((FRAMES, 0))
    present = int(np.median((state != TrackState.ABSENT).sum(axis=1)))
    wanted = 1 if result.resolved.people == "one" else people
    noted = any(note == NO_PERSON or "People tracked at a time" in note for note in result.provenance.notes)
    assert present == wanted or noted or options.person, f"{present} of {wanted} people"


def run_live(options: Options, people: int) -> None:
    """Track frame by frame and check the people."""
    rig, detections = recording(people)
    tracker = posefuse.Tracker(rig, detections.skeleton, options)
    for f in range(detections.n_frames):
        for person in tracker.update(posefuse.Frame.of(detections, f)).people:
            has_point = np.isfinite(person.points_m)
            np.testing.assert_array_equal(has_point.any(axis=-1), has_point.all(axis=-1))
            np.testing.assert_array_equal(np.isfinite(person.covariance_m2).all(axis=-1), has_point.all(axis=-1))


def names_an_option(message: str, values: Mapping[str, Any]) -> bool:
    """Return whether an error names a drawn option, with or without its table, or the option to set instead."""
    words = set(re.findall(r"\w+", message.replace("-", "_")))
    flags, arguments = re.findall(r"--([\w.-]+)", message), re.findall(r"`([\w.]+)", message)
    remedies = {flag.replace("-", "_") for flag in flags} | set(arguments)
    return any(name.rpartition(".")[2] in words for name in values) or bool(remedies & set(options_by_name()))


@pytest.mark.parametrize("people", [pytest.param(1, marks=pytest.mark.long), 2])
def test_default_options_give_the_people_of_the_recording(people):
    run_reconstruction(Options(), people)
    result = posefuse.reconstruct(*recording(people))
    assert len(result.person_ids) == people


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"tracker.smoother_error_memory_s": 0.0}, "accepted"),
        ({"tracker.error_memory_s": 0.0, "tracker.parts.error_memory_s": 0.0}, "accepted"),
        ({"tracker.motion.root_acceleration": 0.0}, "accepted"),
        ({"tracker.motion.turn_acceleration": 0.0, "tracker.motion.limb_acceleration": 0.0}, "accepted"),
        ({"tracker.initiation.promote_log_odds": 500.0}, "accepted"),
        ({"people": "many", "align.height_m": 8.5}, "accepted"),
        ({"align.forward_m": (1e-300, 0.0, 1e300)}, "rejected"),
        ({"align.height_m": 1e9}, "rejected"),
        ({"trajectory.iterations": 10**9, "solve": "trajectory"}, "rejected"),
        ({"pair_search.sds.agents": 10**9}, "rejected"),
        ({"postprocess.smooth": ("butterworth",), "postprocess.butterworth.cutoff_hz": 1e-9}, "rejected"),
        ({"postprocess.smooth": ("butterworth",), "postprocess.butterworth.cutoff_hz": 0.01}, "accepted"),
        ({"postprocess.smooth": ("kalman",), "postprocess.kalman.error_memory_s": 1e30}, "rejected"),
        ({"postprocess.smooth": ("kalman",), "postprocess.kalman.error_memory_s": 60.0}, "accepted"),
        ({"postprocess.smooth": ("hampel",), "postprocess.hampel.window_s": 1e30}, "rejected"),
        ({"trajectory.density_window_s": 1e9, "solve": "trajectory"}, "rejected"),
        ({"cameras": ("cam_0", "cam_1", "cam_0")}, "rejected"),
        ({"person": ("person_1", "person_1")}, "rejected"),
        ({"cameras": ("cam_0",)}, "rejected"),
    ],
)
def test_options_that_once_failed(values, expected):
    assert outcome_of(values, people=2, live=False) == expected


@pytest.mark.parametrize("seed", range(60))
def test_draw_is_sane_or_rejected(seed):
    assert outcome(seed) in ("accepted", "rejected")


@pytest.mark.long
@pytest.mark.parametrize("block", range(20))
def test_two_thousand_draws_are_sane_or_rejected(block):
    found = [outcome(seed) for seed in range(block * BLOCK, (block + 1) * BLOCK)]
    assert 0.3 < found.count("accepted") / BLOCK < 0.95
