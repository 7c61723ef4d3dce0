"""One recording of many: what is to be done, and what came of it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from posefuse.model.options.options import Options

State = Literal["done", "kept", "failed", "not done"]
"""Reconstructed now; as it was, for nothing has changed; not reconstructed; not come to before the batch was ended."""


@dataclass(frozen=True)
class Job:
    """One recording to reconstruct.

    Attributes:
        name: of its result; unlike all others of the batch.
        folder: the recording, absolute.
        output: where its result goes, absolute.
        calibration: for all recordings, or None where each has its own.
        options: of the reconstruction.
        again: whether it is done even where nothing has changed.
        window_s: on a cluster, recordings that hold two such windows are divided among its workers; None for none.
    """

    name: str
    folder: Path
    output: Path
    calibration: Path | None
    options: Options
    again: bool = False
    window_s: float | None = None


@dataclass(frozen=True)
class Numbers:
    """What a result is like, in a few numbers; None where there is none.

    Attributes:
        frames: how many.
        seconds: how long, None without a frame rate.
        cameras: how many.
        people: how many.
        points_share: of the points of people who are there, the share that has coordinates.
        median_px: of the reprojection errors.
        p90_px: of them, nine in ten are smaller.
        sd_mm: how well a typical point is known, by its own account.
    """

    frames: int
    seconds: float | None
    cameras: int
    people: int
    points_share: float | None
    median_px: float | None
    p90_px: float | None
    sd_mm: float | None


@dataclass(frozen=True)
class Outcome:
    """What came of a recording.

    Attributes:
        name: of the result.
        state: whether there is one.
        why: what went wrong, in a sentence; empty where nothing did.
        numbers: of the result, None where there is none.
        warnings: that were given.
    """

    name: str
    state: State
    why: str = ""
    numbers: Numbers | None = None
    warnings: tuple[str, ...] = ()
