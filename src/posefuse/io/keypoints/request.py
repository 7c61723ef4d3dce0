"""What a reader of keypoints is told besides the path."""

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
    """What the user said about keypoint files.

    Attributes:
        skeleton: what the keypoints are, or None to tell from the files.
        rate_hz: frames per second, or None to tell from the files.
        third_channel: what the third number of an array is, or None if nobody said.
        progress: told how far the reading is.
        image_size_px: width and height of the images, or None if nobody said.
        timestamps: when views took their frames, or None to tell from the files and rates.
        nearby: the same, found beside the files: it counts where neither the files nor the user say times or a rate.
        view_rates_hz: frames per second by view, of views that began together.
        reference_view: the view whose frames the others are put to, or None for the slowest.
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
        """The request that options make."""
        skeleton = None if options.skeleton is None else find_skeleton(options.skeleton)
        size = (options.image_size[0], options.image_size[1]) if options.image_size else None
        return cls(
            skeleton, options.rate_hz, options.third_channel, progress or Silent(), size, timestamps, nearby,
            options.rates_hz, options.reference_view,
        )  # fmt: skip


def asked_of(detections: Detections, request: Request, path: Path) -> Detections:
    """What a request makes of detections whose file says everything: another skeleton's keypoints, another rate.

    Raises:
        SkeletonError: if the keypoints cannot be mapped to the skeleton.
    """
    if request.skeleton is not None and request.skeleton.keypoints != detections.skeleton.keypoints:
        held = set(detections.skeleton.sources_of(request.skeleton))
        lacking = [name for name in request.skeleton.keypoints if name not in held]
        detections = detections.to_skeleton(request.skeleton)
        if lacking:
            note = f"{path.name} has nothing for {choices(lacking)} of skeleton {request.skeleton.name}."
            detections = replace(detections, notes=(*detections.notes, note))
    return detections if request.rate_hz is None else detections.with_rate(request.rate_hz)
