"""What a run knows of the people in its videos: their keypoints, and the sound."""

from pathlib import Path
from typing import Any

from posefuse.io.keypoints.read import read_keypoints
from posefuse.io.open_recording import digest_path, keypoint_request
from posefuse.model.detections import Detections
from posefuse.pipeline.run.plan import RunPlan
from posefuse.pipeline.run.sync_stage import hear
from posefuse.progress import Progress


class PeopleInVideos:
    """The keypoints of a run and the sound of its videos, each read once.

    Args:
        plan: plan of the run.
        keypoints: file or folder of the keypoints.
        timestamps: file or folder of frame times, or None.
        progress: receives the progress.
    """

    def __init__(self, plan: RunPlan, keypoints: Path, timestamps: Path | None, progress: Progress) -> None:
        self.plan, self.keypoints, self.timestamps, self.progress = plan, keypoints, timestamps, progress
        self._detections: Detections | None = None
        self._sound: Any = None

    def digests(self) -> dict[str, str]:
        """Return the digests of keypoints and timestamps."""
        stamps = "" if self.timestamps is None else digest_path(self.timestamps)
        return {"keypoints": digest_path(self.keypoints), "timestamps": stamps}

    def detections(self) -> Detections:
        """Return the keypoints."""
        if self._detections is None:
            plan = self.plan
            request = keypoint_request(
                plan.session.folder, self.keypoints, plan.options, self.progress, self.timestamps
            )
            found = read_keypoints(self.keypoints, request)
            rate_hz = plan.options.rate_hz
            self._detections = found.with_rate(rate_hz) if rate_hz and found.rate_hz is None else found
        return self._detections

    def sound(self) -> Any:
        """Return what the sound of the videos shows."""
        if self._sound is None:
            self._sound = hear(self.plan, self.detections().view_names, self.progress)
        return self._sound
