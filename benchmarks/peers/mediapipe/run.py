"""Detect one person in every video of a folder with MediaPipe's full pose model.

``run.py VIDEOS OUTPUT.npz`` writes a file that posefuse reads: ``keypoints``, shape (camera, frame, 33, 2), NaN where
there is no person, ``confidence``, shape (camera, frame, 33), the visibility, ``names`` of the cameras and ``rate_hz``.
Pixel (0, 0) is the center of the top-left pixel.
"""

import argparse
import sys
import types
from pathlib import Path

for _name in ("matplotlib", "matplotlib.pyplot", "sounddevice", "jax"):
    sys.modules[_name] = types.ModuleType(_name)

import cv2  # noqa: E402
import numpy as np  # noqa: E402
from mediapipe.python.solutions.pose import Pose  # noqa: E402

SUFFIXES = {".mp4", ".avi", ".mov", ".mkv"}


def detect(video: Path) -> tuple[np.ndarray, float]:
    """Return x, y and visibility, shape (frame, 33, 3), and the frame rate of a video."""
    capture = cv2.VideoCapture(str(video))
    frames = []
    with Pose(static_image_mode=False, model_complexity=1) as pose:
        while True:
            read, image = capture.read()
            if not read:
                break
            height, width = image.shape[:2]
            found = pose.process(cv2.cvtColor(image, cv2.COLOR_BGR2RGB)).pose_landmarks
            rows = np.full((33, 3), np.nan)
            if found is not None:
                rows[:] = [(mark.x * width - 0.5, mark.y * height - 0.5, mark.visibility) for mark in found.landmark]
            frames.append(rows)
    rate_hz = capture.get(cv2.CAP_PROP_FPS)
    capture.release()
    return np.array(frames), rate_hz


def main() -> None:
    """Detect and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("videos", type=Path)
    parser.add_argument("output", type=Path)
    given = parser.parse_args()
    videos = sorted(each for each in given.videos.iterdir() if each.suffix.lower() in SUFFIXES)
    found = [detect(video) for video in videos]
    if len({rate for _, rate in found}) != 1:
        parser.error(f"the videos must have the same frame rate, got {[rate for _, rate in found]}")
    rows = np.full((len(found), max(len(each) for each, _ in found), 33, 3), np.nan)
    for v, (each, _) in enumerate(found):
        rows[v, : len(each)] = each
    given.output.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(
        given.output,
        keypoints=rows[..., :2],
        confidence=rows[..., 2],
        names=np.array([video.stem for video in videos]),
        rate_hz=found[0][1],
    )


if __name__ == "__main__":
    main()
