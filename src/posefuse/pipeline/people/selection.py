"""Select tracked people by name."""

from collections.abc import Sequence

import numpy as np

from posefuse.errors import OptionsError, choices
from posefuse.model.tracks import Tracks


def select_people(tracks: Tracks, names: Sequence[str]) -> tuple[Tracks, list[int]]:
    """Return the tracks of some people, and their columns among all.

    Raises:
        OptionsError: if a person does not exist.
    """
    known = tracks.person_ids
    for name in names:
        if name not in known:
            raise OptionsError(f"person: no person is called {name!r}; the people are {choices(known, 20)}.")
    keep = [known.index(name) for name in names]
    return Tracks(tuple(names), np.asarray(tracks.detection)[:, keep], np.asarray(tracks.state)[:, keep]), keep
