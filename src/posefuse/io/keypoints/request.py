"""What a reader of keypoints is told besides the path."""

from dataclasses import dataclass, field

from posefuse.model.options import Options, ThirdChannel
from posefuse.model.skeletons import Skeleton, find_skeleton
from posefuse.progress import Progress, Silent


@dataclass(frozen=True)
class Request:
    """What the user said about keypoint files.

    Attributes:
        skeleton: what the keypoints are, or None to tell from the files.
        rate_hz: frames per second, or None to tell from the files.
        third_channel: what the third number of an array is, or None if nobody said.
        progress: told how far the reading is.
    """

    skeleton: Skeleton | None = None
    rate_hz: float | None = None
    third_channel: ThirdChannel | None = None
    progress: Progress = field(default_factory=Silent)

    @classmethod
    def of(cls, options: Options, progress: Progress | None = None) -> "Request":
        """The request that options make."""
        skeleton = None if options.skeleton is None else find_skeleton(options.skeleton)
        return cls(skeleton, options.rate_hz, options.third_channel, progress or Silent())
