"""Show a result in napari: a points layer with one color per person, and a tracks layer of one keypoint.

Run it in an environment with napari and pandas (`pip install 'napari[all]' pandas`); posefuse is not needed there.
`python napari_layers.py RESULT` opens the window. Axes are time, z, y, x; lengths are in meters.
"""

import sys
from pathlib import Path

import napari
import pandas as pd

AXES = ["frame", "z_m", "y_m", "x_m"]
FRAMES_SHOWN = 50
"""Length of the tail of a track."""


def read_points(folder: Path) -> pd.DataFrame:
    """Read the points of a result; rows without coordinates are dropped."""
    solved = folder / "solved.csv"
    table = pd.read_csv(solved if solved.exists() else folder / "keypoints.csv")
    return table.dropna(subset=AXES)


def add_layers(viewer: napari.Viewer, table: pd.DataFrame, tracked: str) -> None:
    """Add all keypoints as points, and one of them as a track per person."""
    viewer.dims.ndisplay = 3
    features = table[["person", "keypoint", "status"]].reset_index(drop=True)
    viewer.add_points(table[AXES], features=features, face_color="person", size=0.03, name="keypoints")
    one = table[table["keypoint"] == tracked]
    number = pd.Categorical(one["person"]).codes
    tracks = pd.concat([pd.Series(number, one.index, name="track"), one[AXES]], axis=1).sort_values(["track", "frame"])
    viewer.add_tracks(tracks, tail_length=FRAMES_SHOWN, name=tracked)


def main() -> None:
    """Open the window."""
    table = read_points(Path(sys.argv[1]))
    viewer = napari.Viewer()
    add_layers(viewer, table, sys.argv[2] if len(sys.argv) > 2 else table["keypoint"].iloc[0])
    print({layer.name: len(layer.data) for layer in viewer.layers})
    if "--close" not in sys.argv:
        napari.run()


if __name__ == "__main__":
    main()
