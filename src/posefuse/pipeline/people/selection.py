"""Some of the people who were followed, by name."""

from collections.abc import Sequence

import numpy as np

from posefuse.errors import OptionsError, choices
from posefuse.model.tracks import Tracks


def kept_tracks(tracks: Tracks, names: Sequence[str]) -> tuple[Tracks, list[int]]:
    """The tracks of some people, and their places among all.

    Raises:
        OptionsError: if there is nobody of a name.
    """
    there = tracks.person_ids
    for name in names:
        if name not in there:
            raise OptionsError(f"person: nobody is called {name!r}; there are {choices(there, 20)}.")
    keep = [there.index(name) for name in names]
    return Tracks(tuple(names), np.asarray(tracks.detection)[:, keep], np.asarray(tracks.state)[:, keep]), keep
