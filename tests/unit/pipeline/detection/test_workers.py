"""Detectors side by side: their errors, and the people that are kept."""

import threading
from functools import partial

import numpy as np
import pytest

from posefuse.detection.detector import FrameDetections
from posefuse.detection.open import open_detector
from posefuse.errors import DetectorError, OptionsError
from posefuse.io.board_images import ViewImages
from posefuse.io.view_images import open_source
from posefuse.model.options.detection import DetectOptions
from posefuse.pipeline.detection import chunks, workers
from posefuse.pipeline.detection.chunks import ChunkQueue, plan_chunks
from posefuse.pipeline.detection.workers import ChunkDetections, Task, check_rectangles, detect_chunks, strongest
from tests.filmed_blobs import BAR, bar_place, film, find_bars, lefts_of


@pytest.fixture
def sources(tmp_path, monkeypatch):
    monkeypatch.setattr(chunks, "CHUNK_IMAGES", 10)
    views = [
        ViewImages(name, (film(tmp_path / f"{name}.mp4", 40, people=2),), is_video=True) for name in ("a", "b", "c")
    ]
    return [open_source(view) for view in views]


def run(sources, detectors, rectangles=None, max_people=None):
    queue = ChunkQueue(plan_chunks(sources, DetectOptions()))
    return list(detect_chunks(Task(sources, rectangles or {}, max_people), queue, detectors))


def opener(function=find_bars):
    return partial(open_detector, function, skeleton=BAR)


def chunks_of(results) -> list[ChunkDetections]:
    """Return the detections of all chunks, ordered by view and place."""
    return [found for _, found in sorted((each for each in results if not isinstance(each, int)), key=lambda e: e[0])]


def test_any_number_of_detectors_finds_the_same(sources):
    one, three = run(sources, [opener()]), run(sources, [opener()] * 3)
    assert sum(each for each in one if isinstance(each, int)) == 120
    assert sum(each for each in three if isinstance(each, int)) == 120
    for alone, together in zip(chunks_of(one), chunks_of(three), strict=True):
        assert all(np.array_equal(value, together.as_arrays()[name]) for name, value in alone.as_arrays().items())
    (first, *_) = chunks_of(one)
    assert lefts_of(first.keypoints_px[::2]) == [bar_place(int(number))[0] for number in first.numbers]


def test_keypoints_of_a_part_are_in_px_of_the_image(sources):
    (first, *_) = chunks_of(run(sources, [opener()], {"a": (0, 24, 90, 40)}))
    np.testing.assert_allclose(first.keypoints_px[:, 0, 1], bar_place(0, 1)[1] + 2.5, atol=0.6)
    assert first.people.tolist() == [1] * len(first.numbers)


def test_the_first_error_ends_all_workers(sources):
    def failing(image):
        raise ValueError("no memory")

    with pytest.raises(DetectorError, match="The detector failing failed: ValueError: no memory"):
        run(sources, [opener(), opener(failing)])
    assert not [thread for thread in threading.enumerate() if thread.name.startswith(("detector", "posefuse-read"))]


def test_a_detector_that_cannot_be_opened_ends_the_run(sources):
    with pytest.raises(DetectorError, match="absent"):
        run(sources, [partial(open_detector, "absent")])


def test_a_detector_must_answer_for_every_image(sources):
    class Lossy:
        name, version, skeleton, batch_size, several_people = "lossy", "1", BAR, 4, False

        def reset(self):
            pass

        def detect(self, frames):
            return []

        def close(self):
            pass

    with pytest.raises(DetectorError, match="The detector lossy returned 0 results for 4 images"):
        run(sources, [Lossy])


def test_every_chunk_starts_afresh(sources):
    """A detector that counts images since its reset gives each chunk the numbers from zero."""

    class Counter:
        def __init__(self):
            self.count = 0

        def reset(self):
            self.count = 0

        def __call__(self, image):
            self.count += 1
            return np.full((1, 3, 3), float(self.count))

    found = chunks_of(run(sources, [lambda: opener(Counter())()] * 2))
    assert len(found) == 12
    for each in found:
        assert each.keypoints_px[:, 0, 0].tolist() == list(range(1, len(each.numbers) + 1))


def test_large_images_come_in_small_batches(sources, monkeypatch):
    sizes = []

    class Batched:
        name, version, skeleton, batch_size, several_people = "batched", "1", BAR, 8, False

        def reset(self):
            pass

        def detect(self, frames):
            sizes.append(len(frames))
            return [FrameDetections(np.empty((0, 3, 2)), np.empty((0, 3))) for _ in frames]

        def close(self):
            pass

    run(sources, [Batched])
    assert max(sizes) == 8
    monkeypatch.setattr(workers, "_MOST_BATCH_BYTES", 2 * 3 * 96 * 64)
    sizes.clear()
    run(sources, [Batched])
    assert max(sizes) == 2


def test_the_most_confident_people_are_kept_in_order():
    pixels = np.arange(24.0).reshape(4, 3, 2)
    confidence = np.array([[0.2] * 3, [0.9] * 3, [0.5] * 3, [np.nan, 1.0, 1.0]])
    kept = strongest(FrameDetections(pixels, confidence), 2)
    assert np.array_equal(kept.keypoints_px, pixels[[1, 3]])
    assert strongest(FrameDetections(pixels, confidence), 4).keypoints_px.shape == (4, 3, 2)


def test_a_part_beyond_the_image_is_refused(sources):
    with pytest.raises(OptionsError, match="crop of view 'b' reaches to column 100 and row 20, but its images have 96"):
        check_rectangles(sources, {"b": (50, 0, 50, 20)})
