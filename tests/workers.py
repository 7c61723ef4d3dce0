"""Worker files for tests: a detector that needs NumPy alone, with every way to fail."""

import sys
from pathlib import Path

from posefuse.detection.process import WorkerCommand

BRIGHTNESS = '''
"""One person, whose keypoints are at the mean brightness and the size of the image."""
import numpy as np


class Detector:
    skeleton = ["left_end", "right_end"]
    batch_size = 4
    version = "test 1"

    def __init__(self, settings):
        self.settings = settings
        self.count = 0

    def reset(self):
        self.count = 0

    def detect(self, images):
        results = []
        for image in images:
            self.count += 1
            height, width = image.shape[:2]
            results.append(np.array([[[image.mean(), self.count, 1.0], [width, height, 0.5]]]))
        return results
'''

FAILING = """
import os, signal, sys, time
import numpy as np

print("hello from the import")

class Detector:
    skeleton = ["left_end", "right_end"]

    def __init__(self, settings):
        self.how = settings["model"]
        if self.how == "constructor":
            raise ImportError("No module named 'mmpose'")

    def detect(self, images):
        code = int(images[0, 0, 0, 0])
        if code < 100:
            print("text on standard output", flush=True)
            os.write(1, b"and from C\\n")
            return [np.full((1, 2, 3), float(image[0, 0, 0])) for image in images]
        how = self.how
        if how == "exception":
            raise ValueError("the image is too green")
        if how == "segfault":
            print("about to crash", file=sys.stderr, flush=True)
            print("W0000 00:00:1.2 3 a.cc:1] a remark", file=sys.stderr, flush=True)
            os.kill(os.getpid(), signal.SIGSEGV)
        if how == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if how == "exit":
            os._exit(3)
        if how == "memory":
            raise MemoryError()
        if how == "hang":
            time.sleep(60)
        if how == "shape":
            return [np.zeros((1, 5, 3))] * len(images)
        if how == "count":
            return []
        if how == "infinite":
            return [np.full((1, 2, 3), np.inf)] * len(images)
        if how == "text":
            return ["nothing"] * len(images)
        if how == "missing":
            people = np.array([[[1.0, np.nan, 0.5], [1.0, 2.0, 0.5]], [[np.nan] * 3] * 2])
            return [(people, [[0, 0, 1, 1], [1, 1, 2, 2]])]
        return [None] * len(images)
"""


def worker_file(folder: Path, text: str, name: str = "own") -> Path:
    """Write a worker file."""
    path = folder / f"{name}.py"
    path.write_text(text)
    return path


def worker_command(folder: Path, text: str, name: str = "own") -> WorkerCommand:
    """Return the command that runs a worker file in this Python."""
    return WorkerCommand(name, Path(sys.executable), worker_file(folder, text, name))
