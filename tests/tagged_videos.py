"""Videos with the tags by which cameras state when they started."""

from pathlib import Path

import av
import numpy as np


def tagged_video(path: Path, *, created: str = "", timecode: str = "", n_frames: int = 50, rate_hz: int = 25) -> Path:
    """Write a small video with a time of creation, a timecode, or none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        if created:
            container.metadata["creation_time"] = created
        stream = container.add_stream("libx264", rate=rate_hz)
        stream.width = stream.height = 64
        stream.pix_fmt = "yuv420p"
        if timecode:
            stream.metadata["timecode"] = timecode
        for number in range(n_frames):
            image = av.VideoFrame.from_ndarray(np.full((64, 64, 3), number % 200, dtype=np.uint8), format="rgb24")
            image.pts = number
            container.mux(stream.encode(image))
        container.mux(stream.encode(None))
    return path
