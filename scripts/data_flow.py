"""Count the source files that a recording's detections visit before the measured layer, and the returns to a file.

Run ``python scripts/data_flow.py``. The script reconstructs a simulated recording and notes every call of a function
that receives the detections of the whole recording, from reading until the first range of frames is measured. Samples
and ranges of frames are not counted, nor are methods of the class itself. A return is a visit to a file that the
detections had left before.
"""

import sys
import tempfile
from pathlib import Path
from types import FrameType
from typing import Any

import posefuse
from posefuse.model import detections as model
from posefuse.model.detections import Detections
from posefuse.pipeline import measured_layer
from posefuse.synthetic.options import SceneOptions
from posefuse.synthetic.scenes import simulate

PACKAGE = Path(posefuse.__file__).parent
MEASURED = measured_layer.reconstruct_chunks.__code__


class Trace:
    """Records the files whose functions receive the whole recording's detections."""

    def __init__(self) -> None:
        self.files: list[str] = []
        self.parts: list[Detections] = []
        self.n_frames = 0
        self.ended = False

    def __call__(self, frame: FrameType, event: str, result: Any) -> None:
        """Handle one event of :func:`sys.setprofile`."""
        name = Path(frame.f_code.co_filename)
        if self.ended or not name.is_relative_to(PACKAGE):
            return
        if frame.f_code is MEASURED:
            self.ended = True
        elif event == "return" and name == Path(model.__file__) and frame.f_code.co_name in ("frames", "pieces"):
            # Ranges and samples; kept, so that no other object gets their identity.
            self.parts.append(result)
        elif event == "return" and frame.f_code.co_name == "open_recording":
            self.n_frames = result.detections.n_frames
        elif event == "call" and self.n_frames and name != Path(model.__file__) and self._receives(frame):
            file = name.relative_to(PACKAGE).as_posix()
            if self.files[-1:] != [file]:
                self.files.append(file)

    def _receives(self, frame: FrameType) -> bool:
        code = frame.f_code
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        values = (frame.f_locals.get(name) for name in names)
        return any(isinstance(value, Detections) and self._is_whole(value) for value in values)

    def _is_whole(self, detections: Detections) -> bool:
        return detections.n_frames == self.n_frames and not any(detections is part for part in self.parts)


def trace_recording(folder: Path) -> Trace:
    """Reconstruct a simulated recording of one person and return the trace of its detections."""
    from posefuse.cli.simulate import write_scene

    recording = folder / "recording"
    recording.mkdir()
    # Long enough that samples of the recording are shorter than the recording.
    write_scene(simulate(SceneOptions(duration_s=36.0)), recording)
    trace = Trace()
    sys.setprofile(trace)
    try:
        posefuse.reconstruct_recording(recording, folder / "result")
    finally:
        sys.setprofile(None)
    return trace


def main() -> None:
    """Print the files in the order in which they are visited, their number, and the number of returns."""
    with tempfile.TemporaryDirectory() as folder:
        files = trace_recording(Path(folder)).files
    for file in files:
        print(file)
    print(f"files: {len(set(files))}, returns: {len(files) - len(set(files))}")


if __name__ == "__main__":
    main()
