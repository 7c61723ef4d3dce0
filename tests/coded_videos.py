"""Videos whose images contain their own number, and a detector that knows where a simulated person is in each.

Real decoding, times and image sizes take part, and the keypoints are those of a person whom calibrated cameras film.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from posefuse.io.videos.writer import write_video
from posefuse.model.cameras import CameraRig
from posefuse.skeleton.skeletons import Skeleton
from posefuse.synthetic.rigs import build_rig
from tests.filmed_people import filmed_person

SIZE_PX = (320, 180)
_BITS, _BLOCK_PX = 16, 20
_WORKER = """
import numpy as np

_KNOWN = np.load({!r})


class Detector:
    skeleton = {!r}
    version = "1"

    def __init__(self, settings):
        pass

    def detect(self, images):
        results = []
        for image in images:
            bits = [int(np.median(image[5:15, 20 * b + 5 : 20 * b + 15]) > 128) << b for b in range(16)]
            results.append(_KNOWN["arr_%d" % (sum(bits) >> 12)][sum(bits) & 0xFFF])
        return results
"""


def small_rig(n: int = 4) -> CameraRig:
    """Cameras in the corners of a room, with small images."""
    rig = build_rig("corners", n)
    cameras = []
    for camera in rig.cameras:
        scale = SIZE_PX[0] / camera.size_px[0]
        matrix = camera.matrix.copy()
        matrix[:2] *= scale
        matrix[:2, 2] += 0.5 * (scale - 1.0)
        cameras.append(replace(camera, size_px=SIZE_PX, matrix=matrix))
    return replace(rig, cameras=tuple(cameras))


@dataclass(frozen=True, eq=False)
class FilmedPerson:
    """Videos of a person.

    Attributes:
        rig: the true cameras.
        skeleton: skeleton of the detector.
        detector: function of an image that returns its keypoints.
        keypoints: keypoints of each view, shape (frame, person, keypoint, 3): x, y and confidence.
    """

    rig: CameraRig
    skeleton: Skeleton
    detector: Callable[[np.ndarray], np.ndarray]
    keypoints: list[np.ndarray]

    def worker_file(self, folder: Path) -> Path:
        """Write the detector as a worker file, with its keypoints beside it."""
        np.savez(folder / "known.npz", *self.keypoints)
        path = folder / "coded.py"
        path.write_text(_WORKER.format(str(folder / "known.npz"), self.skeleton.name))
        return path


def film_person(
    folder: Path,
    *,
    n: int = 4,
    duration_s: float = 8.0,
    offsets_s: Sequence[float] = (),
    rates_hz: Sequence[float] = (),
    seed: int = 0,
) -> FilmedPerson:
    """Write one video per camera into a folder: ``cam_0.mp4`` and so on."""
    rig = small_rig(n)
    rates = tuple(rates_hz) or (25.0,) * n
    people = filmed_person(
        rig, np.random.default_rng(seed), duration_s=duration_s, offsets_s=tuple(offsets_s), rates_hz=rates,
        sigma_px=0.5,
    )  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    for v, view in enumerate(people.views):
        with write_video(folder / f"{rig.names[v]}.mp4", SIZE_PX, rates[v]) as writer:
            for frame in range(len(view.time_s)):
                writer.add(coded_image(v, frame), frame / rates[v])
    keypoints = [np.concatenate([v.keypoints_px, v.confidence[..., None]], axis=-1) for v in people.views]

    def detector(image: np.ndarray) -> np.ndarray:
        v, frame = code_of(image)
        return keypoints[v][frame]

    return FilmedPerson(rig, people.skeleton, detector, keypoints)


def coded_image(view: int, frame: int) -> np.ndarray:
    """Return an image with one black or white block per bit of the number of its view and frame."""
    image = np.full((SIZE_PX[1], SIZE_PX[0], 3), 90, dtype=np.uint8)
    for bit in range(_BITS):
        left = bit * _BLOCK_PX
        image[:_BLOCK_PX, left : left + _BLOCK_PX] = 255 if (view << 12 | frame) >> bit & 1 else 0
    return image


def code_of(image: np.ndarray) -> tuple[int, int]:
    """Return the numbers of view and frame in an image."""
    code = 0
    for bit in range(_BITS):
        left = bit * _BLOCK_PX
        code |= int(np.median(image[5:15, left + 5 : left + 15]) > 128) << bit
    return code >> 12, code & 0xFFF
