"""Input and result of the assignment of left and right."""

from dataclasses import dataclass, replace

import numpy as np

from posefuse.left_right.pairs.results import SolvedPairs
from posefuse.model.cameras import CameraRig
from posefuse.model.detections import Detections
from posefuse.model.tracks import Tracks
from posefuse.skeleton.skeletons import Skeleton

DEFAULT_RATE_HZ = 30.0


@dataclass(frozen=True, eq=False)
class PairSequence:
    """Hold label-free pair solutions over time and other cues for left and right.

    Attributes:
        pairs: of ``person_frame = frame * people + person``; the pair axis is that of the skeleton.
        skeleton: pairs of keypoints and their chains.
        rig: the cameras, in the order of the view axis.
        time_s: shape (frame,): finite and increasing.
        confidence: shape (frame, person, pair, view, 2): detector confidences of the left and the right label, or None.
        midline_m: shape (frame, person, keypoint, 3): positions of unpaired keypoints; NaN elsewhere, or None.
        n_people: number of people interleaved in the person_frame axis.
    """

    pairs: SolvedPairs
    skeleton: Skeleton
    rig: CameraRig
    time_s: np.ndarray
    confidence: np.ndarray | None = None
    midline_m: np.ndarray | None = None
    n_people: int = 1

    @classmethod
    def of(
        cls,
        pairs: SolvedPairs,
        rig: CameraRig,
        detections: Detections,
        tracks: Tracks,
        midline_m: np.ndarray | None = None,
    ) -> "PairSequence":
        """Add times and confidences from the detections from which the pairs were solved."""
        rows = tracks.rows(detections)
        skeleton = detections.skeleton
        columns = skeleton.pair_indices
        confidence = np.full((*rows.shape, *columns.shape), np.nan)
        confidence[rows >= 0] = np.asarray(detections.confidence)[rows[rows >= 0]][:, columns]
        return cls(
            pairs=pairs,
            skeleton=skeleton,
            rig=rig,
            time_s=aligned_frame_times(detections),
            confidence=np.moveaxis(confidence, 2, 3),
            midline_m=midline_m,
            n_people=rows.shape[1],
        )

    @property
    def n_frames(self) -> int:
        """Return the number of frames."""
        return len(self.time_s)

    def by_frame(self, array: np.ndarray) -> np.ndarray:
        """Split the person_frame axis of an array into frame and person."""
        return np.asarray(array).reshape(self.n_frames, self.n_people, *array.shape[1:])


@dataclass(frozen=True, eq=False)
class SideAssignment:
    """Hold the assignment of left and right, and the views with swapped labels.

    Attributes:
        flipped: shape (frame, person, pair), bool: the second point is the left one.
        chain_swapped: shape (frame, person, view, chain), int8: 1 if the view's labels of the chain are swapped, 0 if
            not, -1 if the view has no decisive observation.
        chains: names of the chains; a pair in no chain forms a chain of its own, with its name.
        notes: warnings for the user.
    """

    flipped: np.ndarray
    chain_swapped: np.ndarray
    chains: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def applied(self, pairs: SolvedPairs) -> SolvedPairs:
        """Return the pairs with the left point first.

        Their evidence then states whether a view's labels are swapped.
        """
        flipped = self.flipped.reshape(-1, self.flipped.shape[-1])
        by_point = flipped[:, :, None, None]
        return replace(
            pairs,
            points_m=np.where(by_point, pairs.points_m[:, :, ::-1], pairs.points_m),
            covariance_m2=np.where(by_point, pairs.covariance_m2[:, :, ::-1], pairs.covariance_m2),
            status=np.where(flipped[:, :, None], pairs.status[:, :, ::-1], pairs.status),
            used=np.where(by_point, pairs.used[..., ::-1], pairs.used),
            view_error_px=np.where(by_point, pairs.view_error_px[..., ::-1], pairs.view_error_px),
            evidence=np.where(flipped[:, :, None], -pairs.evidence, pairs.evidence),
        )


def aligned_frame_times(detections: Detections) -> np.ndarray:
    """Return increasing frame times, shape (frame,), as the mean over the views that recorded each frame.

    Clocks of the views are aligned first. Times follow from the frame rate, or 30 Hz, if they are unknown or not
    increasing.
    """
    numbers = detections.frame_numbers.astype(np.float64)
    step_s = 1.0 / (detections.rate_hz or DEFAULT_RATE_HZ)
    by_rate = (numbers - numbers[:1]) * step_s
    times = np.asarray(detections.time_s)
    known = np.isfinite(times)
    offsets = [
        np.median((times[:, v] - by_rate)[known[:, v]]) if known[:, v].any() else 0.0 for v in range(times.shape[1])
    ]
    aligned = np.where(known, times - np.array(offsets), 0.0)
    mean = np.where(known.any(axis=1), aligned.sum(axis=1) / np.maximum(known.sum(axis=1), 1), by_rate)
    return mean if (np.diff(mean) > 0.0).all() else by_rate
