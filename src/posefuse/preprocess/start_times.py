"""Views that start seconds apart: correct their times and align them on a new timeline."""

from dataclasses import replace

import numpy as np

from posefuse.errors import DetectionsError
from posefuse.model.detections import Detections
from posefuse.model.options.sync import SyncOptions
from posefuse.preprocess.timeline import align_views


def with_start_times(detections: Detections, sync: SyncOptions) -> Detections:
    """Return detections with corrected times of the views, aligned on a common timeline.

    Unlike the correction during a reconstruction, no keypoint is interpolated, and frames that only some of the views
    recorded are kept.

    Args:
        detections: detections with times.
        sync: time offsets by the names of the views; views that are not named keep their times.

    Raises:
        DetectionsError: if frames have no times, or no two views recorded a frame at the same corrected time.
    """
    if sync.does_nothing:
        return detections
    time_s = np.array(detections.time_s)
    if not np.isfinite(time_s).any():
        raise DetectionsError("Time offsets need times, but the files contain no frame rate. Add `rate_hz`.")
    for v, name in enumerate(detections.view_names):
        time_s[:, v] += sync.offset_at(name, time_s[:, v])
    return align_views(replace(detections, time_s=time_s))
