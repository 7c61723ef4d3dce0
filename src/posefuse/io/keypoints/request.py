"""Options for reading keypoint files."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from posefuse.errors import choices
from posefuse.io.timestamps import Timestamps
from posefuse.model.detections import Detections
from posefuse.model.options.options import Options, ThirdChannel
from posefuse.progress import Progress, Silent
from posefuse.skeleton.skeletons import Skeleton, find_skeleton


@dataclass(frozen=True)
class Request:
    """How to read keypoint files.

    Attributes:
        skeleton: Skeleton of the keypoints, or None to infer it from the files.
        rate_hz: Frame rate, or None to read it from the files.
        third_channel: Meaning of the third number per keypoint of an array, or None if it is not stated.
        progress: Receives the progress of reading.
        image_size_px: Width and height of the images, or None if they are not stated.
        timestamps: Timestamps of the views, or None to use those of the files or the rates.
        nearby: Timestamps found beside the files. They are used if neither the files nor the user give times or a rate.
        view_rates_hz: Frame rates by view, for views that started together.
        reference_view: View to whose frames the others are matched, or None for the slowest.
    """

    skeleton: Skeleton | None = None
    rate_hz: float | None = None
    third_channel: ThirdChannel | None = None
    progress: Progress = field(default_factory=Silent)
    image_size_px: tuple[int, int] | None = None
    timestamps: Timestamps | None = None
    nearby: Timestamps | None = None
    view_rates_hz: Mapping[str, float] = field(default_factory=dict)
    reference_view: str | None = None

    @classmethod
    def of(
        cls,
        options: Options,
        progress: Progress | None = None,
        timestamps: Timestamps | None = None,
        nearby: Timestamps | None = None,
    ) -> "Request":
        """Return the request for options.

        Raises:
            SkeletonError: If the skeleton of the options does not exist.
        """
        skeleton = None if options.skeleton is None else find_skeleton(options.skeleton)
        size = (options.image_size[0], options.image_size[1]) if options.image_size else None
        return cls(
            skeleton, options.rate_hz, options.third_channel, progress or Silent(), size, timestamps, nearby,
            options.rates_hz, options.reference_view,
        )  # fmt: skip


def apply_request(detections: Detections, request: Request, path: Path) -> Detections:
    """Convert detections of a self-describing file to the skeleton and rate of a request.

    Args:
        detections: Detections as stored.
        request: Requested skeleton and rate. Either may be None.
        path: The file, for notes.

    Raises:
        SkeletonError: If the keypoints cannot be mapped to the skeleton.
    """
    if request.skeleton is not None and request.skeleton.keypoints != detections.skeleton.keypoints:
        available = set(detections.skeleton.sources_of(request.skeleton))
        missing = [name for name in request.skeleton.keypoints if name not in available]
        detections = detections.to_skeleton(request.skeleton)
        if missing:
            note = f"{path.name} has no keypoints for {choices(missing)} of skeleton {request.skeleton.name}."
            detections = replace(detections, notes=(*detections.notes, note))
    return detections if request.rate_hz is None else detections.with_rate(request.rate_hz)
