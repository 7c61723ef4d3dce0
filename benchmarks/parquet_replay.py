"""Measure the memory of reading a large parquet recording in ranges of frames.

``python -m benchmarks.parquet_replay --gigabytes 1``. A detection folder of that size (four views, COCO-WholeBody-133,
three people) is written to a temporary folder and read in ranges of a thousand frames in a separate process. A second
recording of a quarter of the length shows how memory grows with the length.
"""

import time
from pathlib import Path

import numpy as np

from benchmarks.reading import Benchmark, run

_VIEWS, _PEOPLE, _KEYPOINTS = 4, 3, 133
_PIECE = 2000


def write(gigabytes: float, folder: Path) -> int:
    """Write tables of a total size and return the number of frames."""
    import pyarrow.parquet as pq

    rng = np.random.default_rng(0)
    folder.mkdir(parents=True)
    each = gigabytes * 1e9 / _VIEWS
    frames = None
    for v in range(_VIEWS):
        file = folder / f"cam_{v}.parquet"
        table = _table(rng, 0)
        with pq.ParquetWriter(file, table.schema, compression="snappy") as writer:
            start = 0
            while (frames is None and file.stat().st_size < each) or (frames is not None and start < frames):
                writer.write_table(_table(rng, start) if start else table)
                start += _PIECE
        frames = start
    assert frames is not None
    return frames


def _table(rng: np.random.Generator, start: int):
    import pyarrow as pa

    def nested(values: np.ndarray):
        inner = pa.array(values.ravel())
        for length in reversed(values.shape[1:]):
            ends = np.arange(len(inner) // length + 1, dtype=np.int32) * length
            inner = pa.ListArray.from_arrays(pa.array(ends), inner)
        return inner

    shape = _PIECE, _PEOPLE, _KEYPOINTS
    numbers = np.arange(start, start + _PIECE)
    return pa.table(
        {
            "frame_index": pa.array(numbers),
            "timestamp_ns": pa.array(numbers * 40_000_000 + 1_700_000_000_000_000_000),
            "kps": nested(rng.uniform(0, 1920, (*shape, 2)).astype(np.float32)),
            "kps_scores": nested(rng.uniform(size=shape).astype(np.float32)),
        }
    )


def read(folder: Path) -> dict[str, float]:
    """Read a recording in ranges."""
    return read_ranges(folder, "coco_wholebody_133")


def read_ranges(path: Path, skeleton: str | None) -> dict[str, float]:
    """Read a path in ranges of a thousand frames."""
    from posefuse import read_detections

    start = time.perf_counter()
    found = read_detections(path, skeleton)
    opened = time.perf_counter() - start
    total = 0.0
    for chunk in found.chunks(1000):
        total += float(np.nansum(np.asarray(chunk.keypoints_px)[:, 0, 0]))
    return {"frames": found.n_frames, "people": int(found.offsets[-1]), "open_s": opened, "checksum": total}


def line(took: dict[str, float]) -> str:
    """Return the output line of a recording."""
    return (
        f"{took['gigabytes']:.2f} GB, {took['frames']} frames, {took['people']} people: peak {took['peak_mb']:.0f} MB, "
        f"opened in {took['open_s']:.1f} s, read in {took['wall_s']:.1f} s (processor {took['processor_s']:.1f} s)"
    )


if __name__ == "__main__":
    run(Benchmark("benchmarks.parquet_replay", __doc__ or "", "gigabytes", (0.25, 1.0), float, write, read, line))
