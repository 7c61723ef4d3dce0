"""A detector in a worker process, in a Python environment of its own.

The program of the process is :mod:`posefuse.detection.workers.serve`, which describes the protocol. Images are copied
once, into shared memory. The process ends when this one ends, however it ends.
"""

import contextlib
import json
import os
import re
import signal
import subprocess
import threading
import weakref
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from posefuse.detection.detector import FrameDetections, parse_detections
from posefuse.detection.shared_images import SharedImages
from posefuse.detection.workers.serve import GREETING
from posefuse.errors import DetectorError
from posefuse.skeleton.from_names import skeleton_named
from posefuse.skeleton.skeletons import Skeleton, find_skeleton

_OPEN_TIMEOUT_S = 3600.0
"""A detector may download its weights when it is opened."""
_SIGKILL = 9
_REMARK = re.compile(r"[IW]\d{4} |INFO:|WARNING:")
"""How lines of information and warnings of TensorFlow and MediaPipe begin."""
_MOST_LINE_BYTES = 1 << 20
_MOST_PRINTED_BYTES = 1 << 20
"""The most bytes that a Python environment may print before the program starts."""


@dataclass(frozen=True)
class WorkerSettings:
    """What a worker file receives.

    Attributes:
        device: ``auto``, ``cpu`` or ``cuda``.
        threads: number of threads of the detector.
        model: name of the model, or empty for the default.
        weights: paths of files of weights; none for the detector's own.
        description: the tables of the file that describes the model; empty for other workers.
        check: whether the worker must only import what it needs, without weights.
    """

    device: str = "auto"
    threads: int = 1
    model: str = ""
    weights: tuple[str, ...] = ()
    description: Mapping[str, Any] = field(default_factory=dict)
    check: bool = False


@dataclass(frozen=True)
class WorkerCommand:
    """How a worker is started.

    Attributes:
        name: name of the detector, for messages.
        python: interpreter.
        file: worker file.
        isolated: whether the interpreter must not see the packages of the caller's ``PYTHONPATH`` and home.
    """

    name: str
    python: Path
    file: Path
    isolated: bool = True


class WorkerProcess:
    """A detector in a process of its own; see :class:`~posefuse.detection.detector.Detector`.

    After a crash, :meth:`reset` starts the process again.

    Args:
        command: program and its file.
        settings: what the worker file receives.
        timeout_s: the longest that one call may take.

    Raises:
        DetectorError: if the process does not start or the worker file fails.
    """

    def __init__(self, command: WorkerCommand, settings: WorkerSettings | None = None, timeout_s: float = 600.0):
        self.name = command.name
        self._command, self._timeout_s = command, timeout_s
        self._settings = settings or WorkerSettings()
        self._images = SharedImages()
        self._finalizer = weakref.finalize(self, _release, self._images, None)
        self._process: subprocess.Popen[bytes] | None = None
        answer = self._start()
        self.skeleton: Skeleton = _skeleton(answer["skeleton"], command)
        self.version: str = answer["version"]
        self.batch_size: int = max(1, answer["batch_size"])
        self.several_people: bool = answer["several_people"]

    def reset(self) -> None:
        """Forget all earlier images; after a crash, start the process again.

        Raises:
            DetectorError: if the worker fails.
        """
        if self._process is None:
            self._start()
        self._ask({"do": "reset"}, self._timeout_s)

    def detect(self, frames: Sequence[np.ndarray] | np.ndarray) -> list[FrameDetections]:
        """Return the detections of consecutive images of one shape.

        Raises:
            DetectorError: if an image is not RGB in uint8, the images differ in shape, or the worker fails.
        """
        if self._process is None:
            raise DetectorError(f"The detector {self.name} is closed.")
        if len(frames) == 0:
            return []
        for frame in frames:
            if frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape[2] != 3 or frame.shape != frames[0].shape:
                raise DetectorError(
                    "Images must have one shape (height, width, 3) and type uint8, got "
                    f"{frame.shape} and {frame.dtype} after {frames[0].shape}."
                )
        n_bytes = len(frames) * frames[0].nbytes
        if n_bytes > self._images.n_bytes:
            self._images.grow(n_bytes)
            self._map()
        shape = self._images.write(frames)
        answer = self._ask({"do": "detect", "shape": shape}, self._timeout_s)
        source = f"The detector {self.name}"
        results = [self._read_arrays(shapes) for shapes in answer["shapes"]]
        return [parse_detections(result, len(self.skeleton), source) for result in results]

    def close(self) -> None:
        """End the process."""
        self._process = None
        self._finalizer()

    def _start(self) -> dict[str, Any]:
        command = self._command
        serve = files("posefuse.detection.workers").joinpath("serve.py")
        passed = (self._images.descriptor,) if self._images.descriptor >= 0 else ()
        try:
            self._process = subprocess.Popen(
                [str(command.python), str(serve), str(command.file), str(self._images.descriptor)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                pass_fds=passed,
                env=_environment(command, self._settings.threads),
            )
        except OSError as error:
            raise DetectorError(
                f"The detector {self.name} cannot start: {command.python}: {error.strerror or error}."
            ) from None
        self._finalizer.detach()
        self._finalizer = weakref.finalize(self, _release, self._images, self._process)
        self._errors = _Tail(self._process)
        with _Watchdog(self._process, self._timeout_s):
            self._read_greeting()
        answer = self._ask({"do": "open", "settings": asdict(self._settings)}, _OPEN_TIMEOUT_S)
        if self._images.n_bytes:
            self._map()
        return answer

    def _map(self) -> None:
        request = {"do": "map", "bytes": self._images.n_bytes, "tag": self._images.tag}
        self._ask(request, self._timeout_s)

    def _ask(self, request: Mapping[str, Any], timeout_s: float) -> dict[str, Any]:
        """Send a request and return the answer, without its arrays."""
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            raise DetectorError(f"The detector {self.name} is closed.")
        with _Watchdog(process, timeout_s) as watchdog:
            try:
                process.stdin.write(json.dumps(request).encode() + b"\n")
                process.stdin.flush()
                line = process.stdout.readline(_MOST_LINE_BYTES)
            except BrokenPipeError:
                line = b""
        if not line.endswith(b"\n"):
            raise self._crash(watchdog.bitten)
        answer = json.loads(line)
        if "error" in answer:
            self._end()
            place = f" ({answer['place']})" if answer["place"] else ""
            raise DetectorError(f"The detector {self.name} failed: {answer['error'].rstrip('.')}{place}.")
        return answer

    def _read_greeting(self) -> None:
        """Skip what the environment prints before the program starts."""
        assert self._process is not None
        assert self._process.stdout is not None
        skipped = 0
        while True:
            line = self._process.stdout.readline(_MOST_LINE_BYTES)
            skipped += len(line)
            if line.endswith(GREETING):
                return
            if not line or skipped > _MOST_PRINTED_BYTES:
                raise self._crash(timed_out=False)

    def _read_arrays(self, shapes: list[list[int] | None]) -> Any:
        assert self._process is not None
        assert self._process.stdout is not None
        arrays: list[np.ndarray | None] = []
        for shape in shapes:
            if shape is None:
                arrays.append(None)
                continue
            data = self._process.stdout.read(8 * int(np.prod(shape, dtype=np.int64)))
            if len(data) < 8 * int(np.prod(shape, dtype=np.int64)):
                raise self._crash(timed_out=False)
            arrays.append(np.frombuffer(data, dtype="<f8").reshape(shape))
        return tuple(arrays)

    def _crash(self, timed_out: bool) -> DetectorError:
        """End the process, and return the error that says how it ended."""
        process = self._process
        assert process is not None
        try:
            code = process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            code = 0
        self._end()
        # A process that another one killed has no last message of interest.
        last = "" if timed_out or -code in (signal.SIGTERM, _SIGKILL) else self._errors.last_line()
        said = f" Its last message: {last}" if last else ""
        how = f"did not answer within {self._timeout_s:g} s" if timed_out else _ending(code)
        return DetectorError(f"The detector {self.name} {how}.{said}")

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            _stop(process)


class _Watchdog:
    """Kills a process that does not answer in time."""

    def __init__(self, process: subprocess.Popen[bytes], timeout_s: float) -> None:
        self._timer = threading.Timer(timeout_s, self._bite, (process,))
        self._timer.daemon = True
        self.bitten = False

    def _bite(self, process: subprocess.Popen[bytes]) -> None:
        self.bitten = True
        process.kill()

    def __enter__(self) -> "_Watchdog":
        self._timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._timer.cancel()


class _Tail:
    """Reads what a process prints, and keeps the end of it."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._lines: deque[str] = deque(maxlen=20)
        self._thread = threading.Thread(target=self._read, args=(process.stderr,), daemon=True)
        self._thread.start()

    def _read(self, stream: Any) -> None:
        while line := stream.readline(4096):
            self._lines.append(line.decode("utf-8", "replace").strip())
        stream.close()

    def last_line(self) -> str:
        """Return the last line that is neither empty nor a remark of a library, at most 300 characters of it."""
        self._thread.join(timeout=2.0)
        return next((line[:300] for line in reversed(self._lines) if line and not _REMARK.match(line)), "")


def _ending(code: int) -> str:
    """Return how a process ended, in words."""
    if code >= 0:
        return f"ended with exit code {code}"
    name = next((each.name for each in signal.Signals if each.value == -code), f"signal {-code}")
    reason = ", possibly because the memory was exhausted" if name == "SIGKILL" else ""
    return f"was killed ({name}){reason}" if name in ("SIGKILL", "SIGTERM") else f"crashed ({name})"


def _environment(command: WorkerCommand, threads: int) -> dict[str, str]:
    """Return the environment variables of the process."""
    names = {"PYTHONPATH", "PYTHONHOME", "PYTHONSTARTUP", "VIRTUAL_ENV"} if command.isolated else {"PYTHONSTARTUP"}
    kept = {name: value for name, value in os.environ.items() if name not in names}
    libraries = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
    own = {"PYTHONNOUSERSITE": "1"} if command.isolated else {}
    return {**kept, **own, **dict.fromkeys(libraries, str(threads)), "PYTHONIOENCODING": "utf-8"}


def _skeleton(given: str | list[str], command: WorkerCommand) -> Skeleton:
    """Return the skeleton that a worker names: a shipped one, a file relative to its own, or a list of keypoints."""
    if isinstance(given, str):
        return find_skeleton(command.file.parent / given if given.endswith(".toml") else given)
    return skeleton_named(command.name, given)


def _stop(process: subprocess.Popen[bytes]) -> None:
    """Close the pipes of a process, and kill it if it does not end."""
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with contextlib.suppress(BrokenPipeError):
                stream.close()
    try:
        process.wait(timeout=2.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _release(images: SharedImages, process: subprocess.Popen[bytes] | None) -> None:
    if process is not None:
        _stop(process)
    images.close()
