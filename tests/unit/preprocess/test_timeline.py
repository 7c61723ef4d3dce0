"""Alignment of views on a common timeline by time instead of frame numbers."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posefuse import align_views
from posefuse.errors import DetectionsError
from posefuse.model.detections import Detections
from posefuse.preprocess.timeline import nominal_rate_hz
from posefuse.skeleton.skeletons import Skeleton
from tests.properties import examples

DOTS = Skeleton("dots", ("a", "b"))


def of_views(*times: np.ndarray, first: tuple[int, ...] | None = None) -> Detections:
    """Return one person per view and frame whose pixel position is the time; frames are numbered from ``first``."""
    begins = first or (0,) * len(times)
    numbers = np.arange(min(begins), max(b + len(t) for b, t in zip(begins, times, strict=True)))
    recorded = np.stack([(numbers >= b) & (numbers < b + len(t)) for b, t in zip(begins, times, strict=True)], axis=1)
    time_s = np.full(recorded.shape, np.nan)
    for v, each in enumerate(times):
        time_s[recorded[:, v], v] = each
    observed = time_s[recorded]
    pixels = np.repeat(np.stack([100.0 * observed, np.nonzero(recorded)[1]], axis=-1)[:, None], 2, axis=1)
    return Detections(
        DOTS, tuple(f"view_{v}" for v in range(len(times))), numbers, time_s,
        np.concatenate([[0], np.cumsum(recorded.ravel())]), pixels, np.ones(pixels.shape[:2]), recorded,
        np.full(len(pixels), -1),
    )  # fmt: skip


def same_but_for_notes(a: Detections, b: Detections) -> bool:
    return replace(a, notes=(), rate_hz=None) == replace(b, notes=(), rate_hz=None)


def jittered(rng, n, rate, start=0.0, jitter=0.1):
    return start + (np.arange(n) + rng.uniform(-jitter, jitter, n)) / rate


def test_aligned_views_are_unchanged():
    together = of_views(np.arange(9) / 30, np.arange(9) / 30 + 0.01, np.arange(5) / 30)
    assert align_views(together) is together
    assert align_views(of_views(np.arange(5) / 30)).n_frames == 5
    timeless = replace(together, time_s=np.full((9, 3), np.nan))
    assert align_views(timeless) is timeless


def test_half_the_rate():
    actual = align_views(of_views(np.arange(40) / 60, np.arange(20) / 30, np.arange(20) / 30))
    np.testing.assert_allclose(actual.time_s, np.repeat(np.arange(20)[:, None] / 30, 3, axis=1))
    assert actual.recorded.all()
    assert actual.rate_hz == 30
    assert actual.frame_numbers.tolist() == list(range(20))
    pixels, _ = actual.dense()
    np.testing.assert_allclose(pixels[..., 0, 0], 100.0 * actual.time_s)
    assert pixels[0, :, 0, 1].tolist() == [0, 1, 2]
    assert actual.notes == (
        "Views are aligned by time: 20 frames at 30 Hz, following view_1; each view contributes its frame within 16.7 "
        "ms.",
        "View view_0 (60 Hz): 20 of its 40 frames are not used; at most 0.0 ms off.",
    )


def test_faster_view_can_be_the_reference():
    actual = align_views(of_views(np.arange(40) / 60, np.arange(20) / 30), "view_0")
    assert actual.n_frames == 40
    assert actual.recorded[:, 1].tolist() == [True, False] * 20
    assert actual.rate_hz == 60
    assert "20 of the 40 frames missing" in actual.notes[-1]


def test_gaps_stay_gaps_and_frames_beyond_the_reference_are_kept():
    """View 0 lacks frames 4 and 5 and ends early; view 1, twice as fast, begins late and ends late."""
    slow = np.delete(np.arange(10), [4, 5]) / 30
    actual = align_views(of_views(slow, np.arange(6, 26) / 60 + 0.004))
    assert actual.frame_numbers.tolist() == list(range(13))
    assert actual.recorded[:, 0].tolist() == [True] * 4 + [False] * 2 + [True] * 4 + [False] * 3
    assert actual.recorded[:, 1].tolist() == [False] * 3 + [True] * 10
    np.testing.assert_allclose(actual.time_s[3:, 1], np.arange(3, 13) / 30 + 0.004)


@given(seed=st.integers(0, 2**31), shift=st.integers(1, 25), view=st.integers(0, 2))
@examples(40)
def test_start_of_a_file_does_not_matter_with_times(seed, shift, view):
    """The same frames, counted by one file from another moment."""
    rng = np.random.default_rng(seed)
    times = [jittered(rng, 60, 30.0, start=rng.uniform(0, 0.005)) for _ in range(3)]
    times[view] = times[view][: 60 - shift] if rng.random() < 0.5 else times[view][shift:]
    begins = [0, 0, 0]
    begins[view] = round(30 * (times[view][0] - times[(view + 1) % 3][0]))
    right = align_views(of_views(*times, first=tuple(begins)))
    wrong = align_views(of_views(*times, first=(0, 0, 0)))
    assert same_but_for_notes(right, wrong)


@given(seed=st.integers(0, 2**31), view=st.integers(0, 2))
@examples(40)
def test_lost_frames_of_one_view_do_not_affect_the_others(seed, view):
    rng = np.random.default_rng(seed)
    times = [jittered(rng, 60, 30.0) for _ in range(3)]
    whole = align_views(of_views(*times))
    lost = rng.choice(60, 12, replace=False)
    holed = align_views(of_views(*(np.delete(t, lost) if v == view else t for v, t in enumerate(times))))
    assert holed.frame_numbers.tolist() == whole.frame_numbers.tolist()
    kept = np.ones((60, 3), dtype=bool)
    kept[lost, view] = False
    np.testing.assert_array_equal(holed.recorded, kept)
    np.testing.assert_array_equal(holed.time_s[kept], whole.time_s[kept])
    np.testing.assert_array_equal(holed.dense()[0][kept], whole.dense()[0][kept])


@given(
    seed=st.integers(0, 2**31),
    rates=st.lists(st.sampled_from([25.0, 30.0, 50.0, 59.94, 120.0]), min_size=2, max_size=4),
)
@examples(60)
def test_each_frame_is_used_once_within_half_a_period_and_alignment_is_idempotent(seed, rates):
    rng = np.random.default_rng(seed)
    times = [
        np.sort(jittered(rng, int(rng.uniform(1.0, 2.0) * rate), rate, rng.uniform(0, 0.3), 0.2)) for rate in rates
    ]
    given_detections = of_views(*times)
    actual = align_views(given_detections)
    assert align_views(actual) is actual
    assert (np.diff(actual.frame_numbers) > 0).all()
    assert (actual.recorded.any(axis=1)).all()
    spread = np.nanmax(actual.time_s, axis=1) - np.nanmin(actual.time_s, axis=1)
    # Views that are aligned already are returned as they are, without a rate.
    assert spread.max() <= 1.01 / (actual.rate_hz or min(rates))
    for v, each in enumerate(times):
        used = actual.time_s[actual.recorded[:, v], v]
        assert (np.diff(used) > 0).all()
        assert np.isin(used, each).all()
    pixels = actual.dense()[0]
    np.testing.assert_allclose(pixels[actual.recorded][:, 0, 0], 100.0 * actual.time_s[actual.recorded])


def test_rate_follows_from_frame_numbers():
    """Times rounded to a tenth of a millisecond, and a view that has every other frame only."""
    times = np.round(np.arange(100) / 60, 4)
    assert nominal_rate_hz(np.arange(100), times) == pytest.approx(60, rel=1e-4)
    assert nominal_rate_hz(np.arange(0, 100, 2), times[::2]) == pytest.approx(60, rel=1e-4)
    stopped = np.where(np.arange(100) < 50, times, times + 7.0)
    assert nominal_rate_hz(np.arange(100), stopped) == pytest.approx(60, rel=0.01)
    assert nominal_rate_hz(np.arange(3), np.array([np.nan, 1.0, np.nan])) is None


def test_invalid_times_are_errors():
    near = np.arange(9) / 30
    with pytest.raises(DetectionsError, match=r"No two views .* view_0 0.000 to 0.267 s, view_1 50.000 to 50.267 s"):
        align_views(of_views(near, near + 50))
    with pytest.raises(DetectionsError, match=r"view 'view_1' go backward after frame 3"):
        align_views(of_views(near, np.array([0, 1, 2, 3, 1.5, 5, 6, 7, 8]) / 30))
    half = of_views(near, near)
    with pytest.raises(DetectionsError, match="'view_1' has no time for 9 of its 9 frames"):
        align_views(replace(half, time_s=np.where([True, False], half.time_s, np.nan)))
    with pytest.raises(DetectionsError, match="reference_view: 'view_7' is not a view"):
        align_views(half, "view_7")
