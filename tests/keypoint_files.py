"""Writers of other programs' 2D keypoints, for readers to be tested on: each writes detections and gives the path."""

import csv
import json
import pickle
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

from posefuse.io.keypoints import native
from posefuse.model.detections import Detections
from tests.files import write_openpose


def people_of(detections: Detections, frame: int, view: int) -> list[tuple[int, np.ndarray]]:
    """Track and x, y, confidence (NaN as 0) of everybody in a frame of a view."""
    start, stop = detections.offsets[frame * detections.n_views + view :][:2]
    pixels = np.asarray(detections.keypoints_px)[start:stop]
    confidence = np.asarray(detections.confidence)[start:stop]
    tracks = np.asarray(detections.track_ids)[start:stop]
    values = np.nan_to_num(np.concatenate([pixels, confidence[..., None]], axis=-1))
    return [(int(track), rows) for track, rows in zip(tracks, values, strict=True)]


def openpose(detections: Detections, folder: Path) -> Path:
    return write_openpose(folder, detections, suffix="")


def mmpose(detections: Detections, folder: Path) -> Path:
    """With ``meta_info``."""
    return _mmpose(detections, folder, lambda frames: {"meta_info": {"name": "x"}, "instance_info": frames})


def rtmlib(detections: Detections, folder: Path) -> Path:
    """A bare list."""
    return _mmpose(detections, folder, lambda frames: frames)


def _mmpose(detections: Detections, folder: Path, wrap: Callable) -> Path:
    for v, name in enumerate(detections.view_names):
        frames = [
            {
                "frame_id": int(number),
                "instances": [
                    {"keypoints": rows[:, :2].tolist(), "keypoint_scores": rows[:, 2].tolist(), "track_id": track}
                    for track, rows in people_of(detections, f, v)
                ],
            }
            for f, number in enumerate(detections.frame_numbers)
        ]
        _json(folder / f"{name}.json", wrap(frames))
    return folder


def alphapose(detections: Detections, folder: Path) -> Path:
    for v, name in enumerate(detections.view_names):
        people = [
            {
                "image_id": f"{number}.jpg",
                "category_id": 1,
                "keypoints": rows.ravel().tolist(),
                "score": 2.5,
                "box": [0, 0, 1, 1],
                "idx": [track],
            }
            for f, number in enumerate(detections.frame_numbers)
            for track, rows in people_of(detections, f, v)
        ]
        _json(folder / name / "alphapose-results.json", people)
    return folder


def coco_results(detections: Detections, folder: Path) -> Path:
    for v, name in enumerate(detections.view_names):
        people = [
            {
                "image_id": int(number),
                "category_id": 1,
                "keypoints": rows.ravel().tolist(),
                "score": 0.9,
                "track_id": track,
            }
            for f, number in enumerate(detections.frame_numbers)
            for track, rows in people_of(detections, f, v)
        ]
        _json(folder / f"{name}.json", people)
    return folder


def coco_annotations(detections: Detections, folder: Path) -> Path:
    """Visibilities, no confidence."""
    skeleton = detections.skeleton
    places = {name: i + 1 for i, name in enumerate(skeleton.keypoints)}
    for v, name in enumerate(detections.view_names):
        people = []
        for f, number in enumerate(detections.frame_numbers):
            for track, rows in people_of(detections, f, v):
                rows = np.column_stack([rows[:, :2], np.where(rows[:, 2] > 0, 2, 0)])
                people.append({"image_id": 100 + int(number), "keypoints": rows.ravel().tolist(), "track_id": track})
        content = {
            "images": [{"id": 100 + int(n), "file_name": f"frame_{n:06d}.png"} for n in detections.frame_numbers],
            "annotations": people,
            "categories": [
                {
                    "id": 1,
                    "keypoints": list(skeleton.keypoints),
                    "skeleton": [[places[a], places[b]] for a, b in skeleton.edges],
                }
            ],
        }
        _json(folder / f"{name}.json", content)
    return folder


def easymocap(detections: Detections, folder: Path) -> Path:
    for v, name in enumerate(detections.view_names):
        for f, number in enumerate(detections.frame_numbers):
            annots = [
                {"personID": track, "bbox": [0, 0, 1, 1, 1], "keypoints": rows.tolist()}
                for track, rows in people_of(detections, f, v)
            ]
            content = {"filename": "x.jpg", "height": 1080, "width": 1920, "annots": annots}
            _json(folder / name / f"{number:06d}.json", content)
    return folder


def deeplabcut_many(detections: Detections, folder: Path) -> Path:
    """CSV with individuals."""
    for name, columns, numbers, values in _deeplabcut(detections):
        path = folder / f"trial_{name}_dlc.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", newline="") as file:
            lines = csv.writer(file)
            for row, title in enumerate(("scorer", "individuals", "bodyparts", "coords")):
                lines.writerow([title, *(column[row] for column in columns)])
            for number, row in zip(numbers, values, strict=True):
                lines.writerow([number, *("" if np.isnan(value) else repr(float(value)) for value in row)])
    return folder


def deeplabcut_h5(detections: Detections, folder: Path) -> Path:
    """As pandas writes its tables with PyTables."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, columns, numbers, values in _deeplabcut(detections):
        with h5py.File(folder / f"trial_{name}_dlc.h5", "w") as file:
            group = file.create_group("df_with_missing")
            group.attrs["non_index_axes"] = np.void(pickle.dumps([(1, columns)], protocol=0))
            kind = [("index", "<i8"), ("values_block_0", "<f8", (values.shape[1],))]
            table = np.empty(len(numbers), dtype=kind)
            table["index"], table["values_block_0"] = numbers, values
            group["table"] = table
    return folder


def _deeplabcut(detections: Detections):
    n_people = int(np.asarray(detections.track_ids).max(initial=0)) + 1
    columns = [
        ("net", f"animal{i}", part, kind)
        for i in range(n_people)
        for part in detections.skeleton.keypoints
        for kind in ("x", "y", "likelihood")
    ]
    for v, name in enumerate(detections.view_names):
        values = np.full((detections.n_frames, n_people, len(detections.skeleton), 3), np.nan)
        for f in range(detections.n_frames):
            for track, rows in people_of(detections, f, v):
                values[f, track] = np.where(rows[:, 2:] > 0, rows, np.nan)
        yield name, columns, detections.frame_numbers, values.reshape(detections.n_frames, -1)


def label3d(detections: Detections, folder: Path) -> Path:
    """One animal, labels only."""
    folder.mkdir(parents=True, exist_ok=True)
    cells = np.empty((detections.n_views, 1), dtype=object)
    names = np.empty((1, detections.n_views), dtype=object)
    for v, name in enumerate(detections.view_names):
        pixels = np.full((detections.n_frames, len(detections.skeleton), 2), np.nan)
        for f in range(detections.n_frames):
            for _, rows in people_of(detections, f, v):
                pixels[f] = np.where(rows[:, 2:] > 0, rows[:, :2], np.nan)
        cells[v, 0] = {
            "data_2d": pixels.reshape(len(pixels), -1),
            "data_frame": detections.frame_numbers[None].astype(float),
        }
        names[0, v] = name
    savemat(folder / "session_dannce.mat", {"labelData": cells, "camnames": names})
    return folder / "session_dannce.mat"


def sleap(detections: Detections, folder: Path) -> Path:
    """Analysis files."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, _, _, values in _deeplabcut(detections):
        rows = values.reshape(detections.n_frames, -1, len(detections.skeleton), 3)
        with h5py.File(folder / f"trial.{name}.analysis.h5", "w") as file:
            file["tracks"] = rows[..., :2].transpose(1, 3, 2, 0)
            file["point_scores"] = rows[..., 2].transpose(1, 2, 0)
            file["node_names"] = np.array([part.encode() for part in detections.skeleton.keypoints])
    return folder


def own(detections: Detections, folder: Path) -> Path:
    """posefuse's own."""
    folder.mkdir(parents=True, exist_ok=True)
    native.write(detections, folder / "keypoints.nc")
    return folder / "keypoints.nc"


def deeplabcut(detections: Detections, folder: Path) -> Path:
    """CSV of one animal."""
    deeplabcut_many(detections, folder)
    for path in folder.glob("*.csv"):
        lines = path.read_text().splitlines()
        path.write_text("\n".join([lines[0], *lines[2:]]) + "\n")
    return folder


WRITERS: dict[str, Callable[[Detections, Path], Path]] = {
    writer.__name__: writer
    for writer in (
        openpose, mmpose, rtmlib, alphapose, coco_results, coco_annotations, easymocap, deeplabcut_many, deeplabcut_h5,
        label3d, sleap, own, deeplabcut,
    )
}  # fmt: skip


def _json(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))
