"""Pictures that show who each person of a result is: where a person is large, whole and alone."""

import io
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from posefuse.model.options.options import LayerName
from posefuse.model.reconstruction import Reconstruction
from posefuse.model.tracks import TrackState
from posefuse.visualize.pillow_extra import require_pillow

_MAX_FRAMES = 300
_MIN_KEYPOINTS = 0.5
_MARGIN = 0.35
_HEIGHT_PX = 320


@dataclass(frozen=True)
class Moment:
    """A view and frame that show a person well.

    Attributes:
        person: index of the person in the result.
        view: index of the camera in the rig.
        frame_index: index of the frame in the result.
        box_px: left, top, right and bottom of the person in the calibrated image.
        score: how well the person is visible; larger is better.
    """

    person: int
    view: int
    frame_index: int
    box_px: tuple[float, float, float, float]
    score: float


def best_moments(result: Reconstruction, layer: LayerName, views: Iterable[int], n: int) -> list[list[Moment]]:
    """Return for each person the best moments of up to ``n`` different views, the best first.

    Args:
        result: the result.
        layer: the layer whose points show where people are.
        views: indices of the cameras that may be used.
        n: largest number of moments per person.
    """
    best: dict[tuple[int, int], Moment] = {}
    stride, first = max(1, -(-result.n_frames // _MAX_FRAMES)), 0
    chosen = list(views)
    for part in result.windows():
        indices = np.arange((-first) % stride, part.n_frames, stride)
        points = np.asarray(part.layers[layer].points_m[:])[indices]
        active = np.ones(points.shape[:2], dtype=bool)
        if part.tracks is not None:
            active = np.asarray(part.tracks.state[:])[indices] == TrackState.ACTIVE
        for view in chosen:
            pixels = part.rig.cameras[view].project(points)[0]
            boxes, scores = _score(pixels, part.rig.cameras[view].size_px, active)
            for person in np.flatnonzero(scores.max(axis=0, initial=0.0) > 0.0).tolist():
                at = int(np.argmax(scores[:, person]))
                left, top, right, bottom = boxes[at, person].tolist()
                found = Moment(
                    person, view, first + int(indices[at]), (left, top, right, bottom), float(scores[at, person])
                )
                if (person, view) not in best or found.score > best[person, view].score:
                    best[person, view] = found
        first += part.n_frames
    return [
        sorted((m for (p, _), m in best.items() if p == person), key=lambda m: (-m.score, m.view))[:n]
        for person in range(len(result.person_ids))
    ]


def _score(pixels: np.ndarray, size_px: tuple[int, int], active: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the boxes of people, shape (frame, person, 4), and their scores, shape (frame, person); 0 if not shown."""
    finite = np.isfinite(pixels).all(axis=-1)
    with np.errstate(invalid="ignore"):
        inside: np.ndarray = finite & np.all((pixels >= 0) & (pixels < np.array(size_px)), axis=-1)
    shown = np.where(inside[..., None], pixels, np.nan)
    enough = active & (inside.sum(axis=-1) >= np.maximum(_MIN_KEYPOINTS * pixels.shape[2], 2))
    low = np.where(enough[..., None], np.nanmin(np.where(inside[..., None], shown, np.inf), axis=2), np.nan)
    high = np.where(enough[..., None], np.nanmax(np.where(inside[..., None], shown, -np.inf), axis=2), np.nan)
    boxes = np.concatenate([low, high], axis=-1)
    area = np.nan_to_num(np.prod(high - low + 1.0, axis=-1))
    overlap = np.zeros(area.shape)
    for other in range(area.shape[1]):
        across = np.minimum(high, high[:, other, None]) - np.maximum(low, low[:, other, None])
        shared = np.nan_to_num(np.prod(np.maximum(across, 0.0), axis=-1))
        shared[:, other] = 0.0
        overlap += shared
    alone = np.maximum(1.0 - overlap / np.maximum(area, 1.0), 0.05)
    whole = inside.sum(axis=-1) / np.maximum(finite.sum(axis=-1), 1)
    return boxes, np.where(enough, np.sqrt(area) * alone * whole**2, 0.0)


def cut_out(image: np.ndarray, box_px: tuple[float, float, float, float]) -> tuple[bytes, tuple[int, int]]:
    """Return the part of an image around a box as JPEG, at most 320 px high, and its width and height.

    Args:
        image: shape (height, width, 3), uint8.
        box_px: left, top, right and bottom in the image.

    Raises:
        ResultError: if Pillow is not installed.
    """
    require_pillow()
    from PIL import Image

    height, width = image.shape[:2]
    left, top, right, bottom = box_px
    margin = _MARGIN * max(right - left, bottom - top, 20.0)
    x0, y0 = max(int(left - margin), 0), max(int(top - margin), 0)
    x1, y1 = min(int(right + margin) + 1, width), min(int(bottom + margin) + 1, height)
    part = Image.fromarray(np.ascontiguousarray(image[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)]))
    scale = min(1.0, _HEIGHT_PX / part.height)
    size = (max(round(part.width * scale), 1), max(round(part.height * scale), 1))
    file = io.BytesIO()
    part.resize(size, Image.Resampling.LANCZOS).save(file, "JPEG", quality=85)
    return file.getvalue(), size
