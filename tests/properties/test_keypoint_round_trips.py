"""Written 2D keypoints are read back in every format, except for the losses that the format reports."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import posefuse
from posefuse.arrays import in_memory
from posefuse.errors import FileError
from posefuse.io.keypoints import detection_tables, native, openpose, replay, tidy
from posefuse.model.detections import Detections
from posefuse.preprocess.timeline import uneven_lengths
from posefuse.skeleton.skeletons import shipped_skeleton
from tests.example_detections import ragged_detections
from tests.properties import examples

seeds = st.integers(0, 2**32 - 1)
names = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"]), min_size=1, max_size=8).filter(
    lambda name: name.strip() == name
)


def any_detections(seed: int, frames: int, views: list[str], skeleton: str | None = None) -> Detections:
    """Return random numbers with gaps, unrecorded frames, and people without any keypoint."""
    rng = np.random.default_rng(seed)
    reference = None if skeleton is None else shipped_skeleton(skeleton)
    detections = ragged_detections(rng, frames, len(views), 4 if reference is None else len(reference))
    recorded = (detections.people_counts > 0) | (rng.random((frames, len(views))) < 0.7)
    recorded[0, 0] = recorded[-1, -1] = True
    shape = np.asarray(detections.confidence).shape
    holes = rng.random(shape) < 0.3
    scale = 10.0 ** rng.integers(-6, 6, shape)
    rate = float(rng.integers(1, 2000) / 8)
    has_people = shape[0] > 0
    return replace(
        detections,
        skeleton=reference or detections.skeleton,
        view_names=tuple(views),
        time_s=np.where(recorded, detections.frame_numbers[:, None] / rate, np.nan),
        recorded=recorded,
        keypoints_px=np.where(holes[..., None], np.nan, rng.normal(size=(*shape, 2)) * scale[..., None]),
        confidence=np.where(holes | (rng.random(shape) < 0.1), np.nan, rng.uniform(size=shape)),
        depth=np.where(holes, np.nan, rng.normal(size=shape)) if has_people and rng.random() < 0.5 else None,
        sigma_px=np.where(rng.random(shape) < 0.1, np.nan, rng.uniform(0.1, 9, shape))
        if has_people and rng.random() < 0.5
        else None,
        rate_hz=rate,
    )


def as_read(detections: Detections) -> Detections:
    """Add the warning about views of unequal length."""
    messages = uneven_lengths(detections)
    return detections if messages is None else replace(detections, notes=(*detections.notes, messages))


recordings = {"seed": seeds, "frames": st.integers(2, 8), "views": st.lists(names, min_size=1, max_size=4, unique=True)}


@given(**recordings)
@examples(25)
def test_tidy_parquet_is_lossless(seed, frames, views):
    original = as_read(replace(any_detections(seed, frames, views), notes=("ä", "another")))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "keypoints.parquet"
        tidy.write(original, path)
        assert tidy.lost(original, path) == ()
        detections = posefuse.read_detections(path)
        assert detections == original
        assert detections.frames(1, 2) == original.frames(1, 2)


@given(**recordings)
@examples(25)
def test_tidy_csv_keeps_all_but_the_reported_losses(seed, frames, views):
    views = sorted(views)
    original = any_detections(seed, frames, views, "coco_17")
    if not original.recorded.any(axis=0).all():
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "keypoints.csv"
        tidy.write(original, path)
        if not original.people_counts.any():
            assert len(tidy.lost(original, path)) == 1
            with pytest.raises(FileError, match="Set `skeleton`"):
                posefuse.read_detections(path)
            assert posefuse.read_detections(path, skeleton="coco_17").frame_numbers.tolist()
            return
        assert tidy.lost(original, path) == ()
        detections = posefuse.read_detections(path)
    if len(original.frame_numbers) > 1 and detections.rate_hz is None:
        original = replace(original, rate_hz=None)
    assert detections == as_read(original)


@given(
    **recordings
    | {"views": st.lists(st.text("abc_019-. ", min_size=1, max_size=6), min_size=1, max_size=3, unique=True)}
)
@examples(25)
def test_detection_tables_are_lossless(seed, frames, views):
    views = [f"v{name}v" for name in views]  # no file is called "v."
    original = as_read(replace(any_detections(seed, frames, views), notes=("ä", "another")))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "replay"
        detection_tables.write(original, path)
        detections = posefuse.read_detections(path)
        assert detections == original
        assert detections.frames(1, 2) == original.frames(1, 2)
        assert detections.views(views[-1:]) == original.views(views[-1:])


@pytest.mark.parametrize("form", ["keypoints.parquet", "replay.jsonl", "tables", "keypoints.nc"])
@given(seed=seeds, gaps=st.lists(st.integers(1, 10**6), min_size=2, max_size=5))
@examples(8)
def test_distant_frame_numbers_are_preserved(form, seed, gaps):
    """Hand-labeled frames are far apart; CSV tables report that they cannot be read back."""
    numbers = np.cumsum([0, 10_000, *gaps])
    detections = any_detections(seed, len(numbers), ["a", "b"])
    detections = replace(detections, frame_numbers=numbers, recorded=np.ones_like(detections.recorded))
    detections = replace(detections, time_s=np.repeat(numbers[:, None] / detections.rate_hz, 2, axis=1))
    writers = {"keypoints.parquet": tidy, "replay.jsonl": replay, "tables": detection_tables, "keypoints.nc": native}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / form
        writers[form].write(detections, path)
        assert writers[form].lost(detections, path) == ()
        assert posefuse.read_detections(path) == detections
        assert "frame numbers with such large gaps" in " ".join(tidy.lost(detections, path.with_suffix(".csv")))


@given(**recordings)
@examples(25)
def test_replays_are_lossless(seed, frames, views):
    original = as_read(replace(any_detections(seed, frames, views), notes=("ä", "another")))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "replay.jsonl"
        replay.write(original, path)
        assert replay.lost(original, path) == ()
        detections = posefuse.read_detections(path)
        assert not in_memory(detections.keypoints_px)
        assert detections == original
        assert detections.frames(1, 2) == original.frames(1, 2)
        assert detections.views(views[-1:]) == original.views(views[-1:])


@given(**recordings, skeleton=st.sampled_from(["body_25", "openpose_137"]))
@examples(10)
def test_openpose_files_keep_all_but_the_reported_losses(seed, frames, views, skeleton):
    views = sorted(f"v{i}_{frames}" for i in range(len(views)))
    detections = any_detections(seed, frames, views, skeleton)
    present = np.isfinite(np.asarray(detections.keypoints_px)).all(axis=-1)
    trust = np.where(present, np.nan_to_num(np.asarray(detections.confidence), nan=1.0), np.nan)
    detections = replace(
        detections,
        confidence=trust,
        depth=None,
        sigma_px=None,
        rate_hz=None,
        time_s=np.full(detections.time_s.shape, np.nan),
    )
    if not detections.recorded.any(axis=0).all() or (detections.people_counts == 0).all():
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pose"
        openpose.write(detections, path)
        named = (
            ("the names of the keypoints; read the files with `skeleton='body_25'`",) if skeleton == "body_25" else ()
        )
        assert openpose.lost(detections, path) == ("times and the frame rate", *named)
        assert posefuse.read_detections(path, skeleton) == as_read(detections)
