"""Run a worker file in this Python, and answer the requests of posefuse on standard input.

``python serve.py WORKER.py`` needs Python 3.8 or later and NumPy; posefuse is not imported. Requests and answers are
lines of JSON. Images come through memory that both processes map, and the arrays of an answer follow its line as bytes.
docs/detect.md describes worker files.
"""

from __future__ import annotations

import importlib.util
import json
import mmap
import os
import signal
import sys
import traceback
from typing import Any, BinaryIO

GREETING = b"posefuse-worker 1\n"


class WorkerFileError(Exception):
    """A worker file that does not fit the protocol; the message needs no place in this program."""

    for_users = True


class Session:
    """One worker: the detector of its file, and the memory of the images."""

    def __init__(self, path: str, memory: int) -> None:
        self.path = path
        self.memory = memory
        self.images: Any = None
        self.detector: Any = None

    def open(self, request: dict[str, Any]) -> tuple[dict[str, Any], list[bytes]]:
        """Create the detector, and describe it."""
        import numpy as np

        spec = importlib.util.spec_from_file_location("posefuse_worker_file", self.path)
        if spec is None or spec.loader is None:
            raise ImportError(f"{self.path} is not a Python file")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        if not hasattr(module, "Detector"):
            raise WorkerFileError(f"{self.path} has no class Detector")
        self.detector = module.Detector(request["settings"])
        for name in ("skeleton", "detect"):
            if not hasattr(self.detector, name):
                raise WorkerFileError(f"the class Detector of {self.path} has no {name}")
        skeleton = self.detector.skeleton
        answer = {
            "skeleton": skeleton if isinstance(skeleton, str) else [str(name) for name in skeleton],
            "version": str(getattr(self.detector, "version", "")),
            "batch_size": int(getattr(self.detector, "batch_size", 1)),
            "several_people": bool(getattr(self.detector, "several_people", True)),
            "python": sys.version.split()[0],
            "numpy": np.__version__,
        }
        return answer, []

    def map(self, request: dict[str, Any]) -> tuple[dict[str, Any], list[bytes]]:
        """Map the memory of the images."""
        size = request["bytes"]
        if os.name == "nt":
            self.images = mmap.mmap(-1, size, tagname=request["tag"])
        else:
            self.images = mmap.mmap(self.memory, size)
        return {}, []

    def reset(self, request: dict[str, Any]) -> tuple[dict[str, Any], list[bytes]]:
        """Reset the detector, if it has a memory."""
        if hasattr(self.detector, "reset"):
            self.detector.reset()
        return {}, []

    def detect(self, request: dict[str, Any]) -> tuple[dict[str, Any], list[bytes]]:
        """Detect the people of the images."""
        import numpy as np

        count = request["shape"][0]
        pixels = int(np.prod(request["shape"]))
        images = np.frombuffer(self.images, dtype=np.uint8, count=pixels).reshape(request["shape"])
        results = list(self.detector.detect(images))
        if len(results) != count:
            raise ValueError(f"detect returned {len(results)} results for {count} images")
        shapes, payload = [], []
        for result in results:
            rows, boxes = result if isinstance(result, tuple) and len(result) == 2 else (result, None)
            try:
                arrays = [None if each is None else np.ascontiguousarray(each, dtype="<f8") for each in (rows, boxes)]
            except (TypeError, ValueError):
                raise WorkerFileError(
                    f"detect returned {type(rows).__name__} for an image that is not an array of numbers. Expected x, "
                    "y and confidence, shape (person, keypoint, 3), or a tuple of this array and boxes, shape "
                    "(person, 4)"
                ) from None
            shapes.append([None if each is None else list(each.shape) for each in arrays])
            payload.extend(each.tobytes() for each in arrays if each is not None)
        return {"shapes": shapes}, payload


def place_of(error: BaseException, path: str) -> str:
    """Return the file and line of an exception, in the worker file if it is on the way."""
    if isinstance(error, SyntaxError):
        return ""  # Its message states the place.
    stack = traceback.extract_tb(error.__traceback__)
    own = [each for each in stack if each.filename == path] or list(stack)
    return f"{os.path.basename(own[-1].filename)}, line {own[-1].lineno}" if own else ""


def answer_requests(session: Session, requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer one request after the other until posefuse closes the pipe."""
    for line in requests:
        request = json.loads(line)
        try:
            answer, payload = getattr(session, request["do"])(request)
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            text = " ".join(str(error).split())
            if getattr(error, "for_users", False):
                answer = {"error": text, "place": ""}
            else:
                answer = {"error": f"{type(error).__name__}: {text}", "place": place_of(error, session.path)}
            payload = []
        answers.write(json.dumps(answer).encode() + b"\n")
        for part in payload:
            answers.write(part)
        answers.flush()


def main() -> None:
    """Serve one worker file."""
    # What the detector prints must not mix with the answers.
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    # Ctrl-C is for posefuse, which then closes the pipe.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Files beside a worker file can be imported, but must not shadow the packages that it imports.
    own = [os.path.dirname(os.path.abspath(path)) for path in (__file__, sys.argv[1])]
    sys.path[:] = [each for each in sys.path if each not in own] + own
    answers.write(GREETING)
    answers.flush()
    answer_requests(Session(os.path.abspath(sys.argv[1]), int(sys.argv[2])), requests, answers)


if __name__ == "__main__":
    main()
