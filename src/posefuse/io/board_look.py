"""Look for a calibration board in a few images of videos and pictures, spread over each of them.

The answer for a view is kept in the cache by the content of its images, so that the same images are examined once.
"""

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from posefuse.detection.boards import identify as identify_module
from posefuse.detection.boards.identify import IdentifiedBoard, identify_board, merged
from posefuse.detection.boards.library import import_opencv
from posefuse.errors import PosefuseError
from posefuse.io.board_images import ImageReader, ViewImages, image_count
from posefuse.io.cache import read_cached, write_cached
from posefuse.io.checkpoints import digest_of
from posefuse.io.videos.reader import open_video

N_SAMPLED = 8
"""Number of images of a view that are examined."""
_DECODED_IMAGES = 600
"""Videos with at most this number of images are decoded; in longer ones, the key images before eight times are read."""
_CACHE = "board_looks"
_BLOCK_BYTES, _N_BLOCKS = 1 << 16, 32
_MIN_SHARE = 0.25


@dataclass(frozen=True)
class BoardLook:
    """What a look at the images of several cameras found.

    Attributes:
        board: the board.
        views: names of the views that show it.
        n_views: number of views that were examined.
        n_images: number of images that were examined.
    """

    board: IdentifiedBoard
    views: tuple[str, ...]
    n_views: int
    n_images: int

    @property
    def is_of_board(self) -> bool:
        """Whether the images were taken of the board: half of the views and a quarter of the images show it."""
        return 2 * len(self.views) >= self.n_views and self.board.n_images >= _MIN_SHARE * self.n_images


def look_for_board(views: Sequence[ViewImages]) -> BoardLook | None:
    """Return the board that sampled images show, or None if they show none, or OpenCV is not installed.

    Args:
        views: images of each camera. Those that cannot be read show no board.
    """
    try:
        import_opencv()
    except PosefuseError:
        return None
    with ThreadPoolExecutor(min(os.cpu_count() or 1, max(len(views), 1))) as pool:
        found = list(pool.map(_look, views))
    seen = {view.name: board for view, board in zip(views, found, strict=True) if board is not None}
    board = merged(list(seen.values()))
    if board is None:
        return None
    names = tuple(name for name, each in seen.items() if each.kind == board.kind)
    n_images = sum(min(N_SAMPLED, len(view.files)) if not view.is_video else N_SAMPLED for view in views)
    return BoardLook(board, names, len(views), n_images)


def _look(view: ViewImages) -> IdentifiedBoard | None:
    """Return the board in sampled images of one view."""
    try:
        files = view.files if view.is_video else [view.files[i] for i in _spread(len(view.files))]
        program = Path(identify_module.__file__).read_bytes()
        key = digest_of(
            {
                "images": [_sampled_digest(file) for file in files],
                "versions": [version("posefuse"), version("av"), import_opencv().__version__],
                "program": hashlib.sha256(program).hexdigest(),
            }
        )
        cached = read_cached(_CACHE, key, ("board",))
        if cached is not None:
            values = json.loads(str(cached["board"]))
            return None if values is None else IdentifiedBoard(**values)
        board = identify_board(list(_samples(view)))
    except (PosefuseError, OSError):
        return None
    write_cached(_CACHE, key, {"board": np.array(json.dumps(None if board is None else asdict(board)))})
    return board


def _samples(view: ViewImages) -> Iterator[np.ndarray]:
    """Yield sampled images of a view, each of shape (height, width), uint8."""
    n = image_count(view)
    if not view.is_video or n <= _DECODED_IMAGES:
        wanted = frozenset(_spread(n))
        for image in ImageReader(view).images(wanted.__contains__):
            yield image.gray
        return
    info = open_video(view.files[0]).info
    duration_s = n / (info.rate_hz or 30.0)
    for k in range(N_SAMPLED):
        from_s = duration_s * (k + 0.5) / N_SAMPLED
        image = next(open_video(view.files[0]).images(from_s=from_s, pixel_format="gray"), None)
        if image is not None:
            yield image.rgb


def _spread(n: int) -> list[int]:
    """Return the indices of samples out of a number of images, in order."""
    return sorted({int((k + 0.5) * n / N_SAMPLED) for k in range(N_SAMPLED)}) if n > 0 else []


def _sampled_digest(file: Path) -> str:
    """Return a digest of a file's size and of blocks spread over it; hashing whole videos takes longer than looking."""
    size = file.stat().st_size
    total = hashlib.sha256(str(size).encode())
    with file.open("rb") as stream:
        for start in np.linspace(0, max(size - _BLOCK_BYTES, 0), _N_BLOCKS).astype(np.int64):
            stream.seek(int(start))
            total.update(stream.read(_BLOCK_BYTES))
    return total.hexdigest()
