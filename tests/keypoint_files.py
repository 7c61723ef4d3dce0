"""Writers of 2D keypoints in formats of other programs, to test readers. Each returns the path that it wrote."""

import csv
import json
import pickle
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow.parquet as pq
import sleap_io
from scipy.io import savemat

from posefuse.io.arrow import arrow_table
from posefuse.io.keypoints import detection_tables, native, replay, tidy
from posefuse.io.keypoints.tidy_columns import columns_of_detections
from posefuse.io.pandas_tables import write_frame
from posefuse.model.detections import Detections
from tests.files import write_openpose


def people_in_view(detections: Detections, frame: int, view: int) -> list[tuple[int, np.ndarray]]:
    """Return track and x, y, confidence (NaN as 0) of each person in a frame of a view."""
    start, stop = detections.offsets[frame * detections.n_views + view :][:2]
    pixels = np.asarray(detections.keypoints_px)[start:stop]
    confidence = np.asarray(detections.confidence)[start:stop]
    tracks = np.asarray(detections.track_ids)[start:stop]
    values = np.nan_to_num(np.concatenate([pixels, confidence[..., None]], axis=-1))
    return [(int(track), rows) for track, rows in zip(tracks, values, strict=True)]


def openpose(detections: Detections, folder: Path) -> Path:
    return write_openpose(folder, detections, suffix="")


def mmpose(detections: Detections, folder: Path) -> Path:
    """Write the object with ``meta_info``."""
    return _mmpose(detections, folder, lambda frames: {"meta_info": {"name": "x"}, "instance_info": frames})


def rtmlib(detections: Detections, folder: Path) -> Path:
    """Write a bare list."""
    return _mmpose(detections, folder, lambda frames: frames)


def _mmpose(detections: Detections, folder: Path, wrap: Callable) -> Path:
    for v, name in enumerate(detections.view_names):
        frames = [
            {
                "frame_id": int(number),
                "instances": [
                    {"keypoints": rows[:, :2].tolist(), "keypoint_scores": rows[:, 2].tolist(), "track_id": track}
                    for track, rows in people_in_view(detections, f, v)
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
            for track, rows in people_in_view(detections, f, v)
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
            for track, rows in people_in_view(detections, f, v)
        ]
        _json(folder / f"{name}.json", people)
    return folder


def coco_annotations(detections: Detections, folder: Path) -> Path:
    """Write annotations with visibilities, without confidence."""
    skeleton = detections.skeleton
    places = {name: i + 1 for i, name in enumerate(skeleton.keypoints)}
    for v, name in enumerate(detections.view_names):
        people = []
        for f, number in enumerate(detections.frame_numbers):
            for track, rows in people_in_view(detections, f, v):
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
                for track, rows in people_in_view(detections, f, v)
            ]
            content = {"filename": "x.jpg", "height": 1080, "width": 1920, "annots": annots}
            _json(folder / name / f"{number:06d}.json", content)
    return folder


def opencap(detections: Detections, folder: Path) -> Path:
    """Write one pickle per camera, like OpenCap does from OpenPose files."""
    for v, name in enumerate(detections.view_names):
        frames = [
            [
                {"person_id": [place], "pose_keypoints_2d": rows.ravel().tolist()}
                for place, (_, rows) in enumerate(people_in_view(detections, f, v))
            ]
            for f in range(detections.n_frames)
        ]
        file = folder / name / "OutputPkl_default" / "walk" / "walk_rotated_pp.pkl"
        file.parent.mkdir(parents=True)
        file.write_bytes(pickle.dumps(frames, protocol=3))
    return folder


def eks(detections: Detections, folder: Path) -> Path:
    """Write the CSV of an ensemble for one animal, with variances."""
    deeplabcut(detections, folder)
    more = ("x_ens_median", "y_ens_median", "x_ens_var", "y_ens_var", "x_posterior_var", "y_posterior_var")
    for path in folder.glob("*.csv"):
        rows = [line.split(",") for line in path.read_text().splitlines()]
        longer = [row[:1] for row in rows]
        for at in range(1, len(rows[0]), 3):
            for row, out in zip(rows, longer, strict=True):
                out += row[at : at + 3]
            for title, out in zip(("ensemble", rows[1][at]), longer[:2], strict=True):
                out += [title] * len(more)
            longer[2] += more
            for row, out in zip(rows[3:], longer[3:], strict=True):
                out += [*row[at : at + 2], "9", "16", "4", "6"]
        path.write_text("\n".join(",".join(row) for row in longer) + "\n")
    return folder


def deeplabcut_many(detections: Detections, folder: Path) -> Path:
    """Write CSV with individuals."""
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
    """Write the table layout of pandas and PyTables."""
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


def deeplabcut_fixed(detections: Detections, folder: Path) -> Path:
    """Write pandas' fixed layout, like movement does."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, columns, numbers, values in _deeplabcut(detections):
        with h5py.File(folder / f"trial_{name}_dlc.h5", "w") as file:
            levels = ("scorer", "individuals", "bodyparts", "coords")
            write_frame(file, "df_with_missing", levels, columns, np.asarray(numbers), [values])
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
            for track, rows in people_in_view(detections, f, v):
                values[f, track] = np.where(rows[:, 2:] > 0, rows, np.nan)
        yield name, columns, detections.frame_numbers, values.reshape(detections.n_frames, -1)


def label3d(detections: Detections, folder: Path) -> Path:
    """Write labels of one animal."""
    folder.mkdir(parents=True, exist_ok=True)
    cells = np.empty((detections.n_views, 1), dtype=object)
    names = np.empty((1, detections.n_views), dtype=object)
    for v, name in enumerate(detections.view_names):
        pixels = np.full((detections.n_frames, len(detections.skeleton), 2), np.nan)
        for f in range(detections.n_frames):
            for _, rows in people_in_view(detections, f, v):
                pixels[f] = np.where(rows[:, 2:] > 0, rows[:, :2], np.nan)
        cells[v, 0] = {
            "data_2d": pixels.reshape(len(pixels), -1),
            "data_frame": detections.frame_numbers[None].astype(float),
        }
        names[0, v] = name
    savemat(folder / "session_dannce.mat", {"labelData": cells, "camnames": names})
    return folder / "session_dannce.mat"


def sleap(detections: Detections, folder: Path) -> Path:
    """Write analysis files."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, _, _, values in _deeplabcut(detections):
        rows = values.reshape(detections.n_frames, -1, len(detections.skeleton), 3)
        with h5py.File(folder / f"trial.{name}.analysis.h5", "w") as file:
            file["tracks"] = rows[..., :2].transpose(1, 3, 2, 0)
            file["point_scores"] = rows[..., 2].transpose(1, 2, 0)
            file["node_names"] = np.array([part.encode() for part in detections.skeleton.keypoints])
    return folder


def own(detections: Detections, folder: Path) -> Path:
    """Write posefuse's own format."""
    folder.mkdir(parents=True, exist_ok=True)
    native.write(detections, folder / "keypoints.nc")
    return folder / "keypoints.nc"


def deeplabcut(detections: Detections, folder: Path) -> Path:
    """Write CSV of one animal."""
    deeplabcut_many(detections, folder)
    for path in folder.glob("*.csv"):
        lines = path.read_text().splitlines()
        path.write_text("\n".join([lines[0], *lines[2:]]) + "\n")
    return folder


def tidy_csv(detections: Detections, folder: Path) -> Path:
    tidy.write(detections, folder / "keypoints.csv")
    return folder / "keypoints.csv"


def tidy_table(detections: Detections, folder: Path) -> Path:
    """Write parquet with the metadata of posefuse."""
    tidy.write(detections, folder / "keypoints.parquet")
    return folder / "keypoints.parquet"


def tidy_of_others(detections: Detections, folder: Path) -> Path:
    """Write parquet without metadata, rows in another order."""
    folder.mkdir(parents=True, exist_ok=True)
    table = arrow_table(columns_of_detections(detections), coded_words=True).drop_columns(["time_s"])
    shuffled = table.take(np.random.default_rng(0).permutation(len(table)))
    pq.write_table(shuffled, folder / "others.parquet")
    return folder / "others.parquet"


def detection_folder(detections: Detections, folder: Path) -> Path:
    """Write parquet tables, one per camera."""
    detection_tables.write(detections, folder / "tables")
    return folder / "tables"


def replay_lines(detections: Detections, folder: Path) -> Path:
    replay.write(detections, folder / "replay.jsonl")
    return folder / "replay.jsonl"


def replay_without_head(detections: Detections, folder: Path) -> Path:
    path = replay_lines(detections, folder)
    path.write_bytes(path.read_bytes().split(b"\n", 1)[1])
    return path


def replay_json(detections: Detections, folder: Path) -> Path:
    """Write one object with the description and all frames."""
    lines = replay_lines(detections, folder).read_text().splitlines()
    (folder / "replay.jsonl").unlink()
    head, *frames = map(json.loads, lines)
    (folder / "replay.json").write_text(json.dumps({**head, "frames": frames}, indent=1))
    return folder / "replay.json"


def payload_lines(detections: Detections, folder: Path) -> Path:
    """Write one record per camera and frame, with times of one clock."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "records.jsonl").open("w") as file:
        for f, number in enumerate(detections.frame_numbers.tolist()):
            for v, name in enumerate(detections.view_names):
                people = [
                    {"keypoints": rows[:, :2].tolist(), "scores": rows[:, 2].tolist(), "track_id": track}
                    for track, rows in people_in_view(detections, f, v)
                ]
                at = 1_700_000_000_000_000_000 + number * 40_000_000
                file.write(json.dumps({"camera": name, "timestamp_ns": at, "payload": {"detections": people}}) + "\n")
    return folder / "records.jsonl"


def payload_arrays(detections: Detections, folder: Path) -> Path:
    """Write one file per camera, a list of records with arrays of people."""
    for v, name in enumerate(detections.view_names):
        records = []
        for f, number in enumerate(detections.frame_numbers.tolist()):
            people = [rows for _, rows in people_in_view(detections, f, v)]
            kps, scores = [rows[:, :2].tolist() for rows in people], [rows[:, 2].tolist() for rows in people]
            records.append({"frame_index": number, "timestamp": 0.04 * number, "kps": kps, "kps_scores": scores})
        _json(folder / f"{name}.json", records)
    return folder


def slp(detections: Detections, folder: Path) -> Path:
    """Write one file for all views."""
    folder.mkdir(parents=True, exist_ok=True)
    skeleton = sleap_io.Skeleton(nodes=list(detections.skeleton.keypoints), edges=list(detections.skeleton.edges))
    videos = [sleap_io.Video(filename=f"{name}.mp4", open_backend=False) for name in detections.view_names]
    tracks = [sleap_io.Track(f"animal_{i}") for i in range(int(np.asarray(detections.track_ids).max(initial=0)) + 1)]
    frames = []
    for f, number in enumerate(detections.frame_numbers.tolist()):
        for v, video in enumerate(videos):
            instances = [
                sleap_io.PredictedInstance.from_numpy(
                    np.where(rows[:, 2:] > 0, rows[:, :2], np.nan), skeleton, point_scores=rows[:, 2],
                    track=tracks[track],
                )
                for track, rows in people_in_view(detections, f, v)
            ]  # fmt: skip
            frames.append(sleap_io.LabeledFrame(video=video, frame_idx=number, instances=instances))
    labels = sleap_io.Labels(frames, videos=videos, skeletons=[skeleton], tracks=tracks)
    sleap_io.save_file(labels, folder / "labels.slp", verbose=False)
    return folder / "labels.slp"


def mediapipe_json(detections: Detections, folder: Path) -> Path:
    """Write landmarks as fractions of a 1920 x 1080 image, one list of people per frame, without identities."""
    for v, name in enumerate(detections.view_names):
        frames = []
        for f, number in enumerate(detections.frame_numbers.tolist()):
            people = [[_landmark(row) for row in rows] for _, rows in people_in_view(detections, f, v)]
            frames.append({"frame": number, "pose_landmarks": people})
        _json(folder / f"{name}.json", {"width": 1920, "height": 1080, "frames": frames})
    return folder


def _landmark(row: np.ndarray) -> dict:
    x, y, trust = (float(value) for value in row)
    return {"x": x / 1920 or None, "y": y / 1080 or None, "z": 0.1, "visibility": trust}


def mediapipe_wide(detections: Detections, folder: Path) -> Path:
    """Write one row per frame in px, one person."""
    return _mediapipe_csv(detections, folder, long=False)


def mediapipe_long(detections: Detections, folder: Path) -> Path:
    """Write one row per landmark in px, one person."""
    return _mediapipe_csv(detections, folder, long=True)


def _mediapipe_csv(detections: Detections, folder: Path, *, long: bool) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    names, kinds = detections.skeleton.keypoints, ("x", "y", "visibility")
    for v, name in enumerate(detections.view_names):
        with (folder / f"{name}.csv").open("w", newline="") as file:
            lines = csv.writer(file)
            header = ["landmark", *kinds] if long else [f"{part}_{kind}".upper() for part in names for kind in kinds]
            lines.writerow(["frame", *header])
            for f, number in enumerate(detections.frame_numbers.tolist()):
                people = people_in_view(detections, f, v) or [(0, np.zeros((len(names), 3)))]
                cells = [[repr(float(c)) if row[2] > 0 else "" for c in row] for row in people[0][1]]
                if long:
                    lines.writerows([number, part, *row] for part, row in zip(names, cells, strict=True))
                else:
                    lines.writerow([number, *(cell for row in cells for cell in row)])
    return folder


WRITERS: dict[str, Callable[[Detections, Path], Path]] = {
    writer.__name__: writer
    for writer in (
        openpose, mmpose, rtmlib, alphapose, coco_results, coco_annotations, easymocap, deeplabcut_many, deeplabcut_h5,
        deeplabcut_fixed, label3d, sleap, own, deeplabcut, tidy_csv, tidy_table, tidy_of_others, detection_folder,
        replay_lines, replay_without_head, replay_json, payload_lines, payload_arrays, slp, mediapipe_json,
        mediapipe_wide, mediapipe_long, opencap, eks,
    )
}  # fmt: skip


def _json(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))
