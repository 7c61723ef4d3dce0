"""Do the views see enough of the same?"""

from typing import TYPE_CHECKING

import numpy as np

from posefuse.diagnostics.findings import Finding, Kind

if TYPE_CHECKING:
    from posefuse.diagnostics.examine import Examination

_ALONE, _TOGETHER = 0.15, 0.3
_FEWEST = 200


def find(examination: "Examination") -> tuple[Finding, ...]:
    """Views that see hardly anything another one sees, and recordings in which hardly anything is seen twice."""
    seen = np.isfinite(examination.seen.pixels[..., 0])
    number = seen.sum(axis=1)
    shown = int((number > 0).sum())
    if seen.shape[1] < 2 or shown < _FEWEST:
        return ()
    share = float((number >= 2).sum() / shown)
    names = examination.evidence.rig.names
    if share < _TOGETHER:
        sentence = (
            f"Only {100 * share:.0f} % of what is seen is seen by two cameras or more; the rest has no place in 3D."
        )
        remedy = "Turn the cameras towards the same volume, or check that all their keypoints were found."
        return (_finding((), share, sentence, remedy),)
    out = []
    for v, name in enumerate(names):
        mine = int(seen[:, v].sum())
        shared = float((seen[:, v] & (number >= 2)).sum() / max(mine, 1))
        if mine == 0:
            out.append(
                _finding((name,), 0.0, f"View {name!r} shows nothing.", f"--exclude-camera {name} leaves it out.")
            )
        elif shared < _ALONE and mine >= _FEWEST:
            sentence = f"Only {100 * shared:.0f} % of what view {name!r} sees is seen by another camera."
            out.append(_finding((name,), shared, sentence, "Turn it towards what the others see."))
    return tuple(out)


def _finding(cameras: tuple[str, ...], size: float, sentence: str, remedy: str) -> Finding:
    return Finding(Kind.OVERLAP, cameras, None, size, "share", np.nan, 0.99, 50.0, sentence, remedy)
