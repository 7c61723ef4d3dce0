"""Chunks of the views' images, and their distribution to workers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from posefuse.io.board_images import ViewImages
from posefuse.io.videos.frame_index import FrameIndex
from posefuse.io.videos.info import VideoInfo
from posefuse.io.view_images import ImageSource
from posefuse.model.options.detection import DetectOptions
from posefuse.pipeline.detection.chunks import CHUNK_IMAGES, Chunk, ChunkQueue, plan_chunks


def source(n_images: int, starts: list[int], rate_hz: float = 25.0) -> ImageSource:
    times_s, numbers = np.arange(n_images) / rate_hz, np.arange(n_images)
    info = VideoInfo(Path("a.mp4"), (96, 64), rate_hz, n_images, "h264", "mp4")
    view = ViewImages("a", (Path("a.mp4"),), is_video=True)
    kept = np.array([0, *[start for start in starts if 0 < start < n_images]])
    return ImageSource(view, (96, 64), times_s, np.unique(kept), FrameIndex(info, times_s, numbers, kept, True))


@given(
    n_images=st.integers(0, 3000),
    starts=st.lists(st.integers(1, 3000), max_size=30),
    every=st.integers(1, 400),
    start_s=st.integers(0, 1300).map(lambda n: n / 10),
)
def test_chunks_cover_the_selected_images_once(n_images, starts, every, start_s):
    of_view = source(n_images, starts)
    chunks = plan_chunks([of_view], DetectOptions(every=every, start_s=start_s))
    examined = [n for chunk in chunks for n in range(chunk.start, chunk.stop) if chunk.wanted(n)]
    assert examined == [n for n in range(n_images) if n % every == 0 and of_view.time_s[n] >= start_s - 1e-6]
    assert sum(chunk.n_images for chunk in chunks) == len(examined)
    assert all(0 < chunk.n_images <= 1.5 * CHUNK_IMAGES for chunk in chunks)


def test_chunks_end_where_decoding_can_start():
    chunks = plan_chunks([source(1000, list(range(0, 1000, 70)))], DetectOptions())
    assert [chunk.start for chunk in chunks] == [0, 280, 560, 840]
    rare = plan_chunks([source(1000, [460])], DetectOptions())
    assert [chunk.start for chunk in rare] == [0, 300, 460, 760]


def test_the_end_is_exclusive():
    (chunk,) = plan_chunks([source(200, [])], DetectOptions(start_s=1.0, end_s=2.0))
    assert (chunk.start, chunk.stop) == (25, 50)


@given(counts=st.lists(st.integers(0, 6), min_size=1, max_size=4), order=st.lists(st.integers(0, 2), max_size=60))
def test_every_chunk_is_taken_once(counts, order):
    chunks = [Chunk(view, 10 * c, 10 * c + 10) for view, count in enumerate(counts) for c in range(count)]
    queue = ChunkQueue(chunks)
    taken = [chunk for worker in order if (chunk := queue.take(worker)) is not None]
    while (chunk := queue.take(0)) is not None:
        taken.append(chunk)
    assert sorted(taken) == chunks


def test_workers_continue_their_videos_and_then_share_the_rest():
    chunks = [Chunk(view, 10 * c, 10 * c + 10) for view in range(2) for c in range(4)]
    queue = ChunkQueue(chunks)
    first, second = queue.take(0), queue.take(1)
    assert (first, second) == (chunks[0], chunks[4])
    assert [queue.take(1) for _ in range(3)] == chunks[5:]
    assert queue.take(0) == chunks[1]
    assert queue.take(1) == chunks[3]  # the second half of what the other worker would read
    assert queue.take(0) == chunks[2]
    assert queue.take(0) is None


def test_finished_chunks_are_not_taken():
    chunks = [replace(Chunk(0, 0, 10), start=10 * c, stop=10 * c + 10) for c in range(4)]
    queue = ChunkQueue(chunks, {chunks[1].name, chunks[2].name})
    assert {queue.take(0), queue.take(0)} == {chunks[0], chunks[3]}
    assert queue.take(0) is None
