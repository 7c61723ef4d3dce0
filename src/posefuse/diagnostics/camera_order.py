"""Have views been given each other's calibrations?"""

from typing import TYPE_CHECKING

import numpy as np

from posefuse.diagnostics.findings import Finding, Kind

if TYPE_CHECKING:
    from posefuse.diagnostics.examine import Examination


def find(examination: "Examination") -> tuple[Finding, ...]:
    """Views that fit other cameras than their own."""
    coarse = examination.coarse
    if coarse is None or not coarse.agreed:
        return ()
    gains = [400.0 * (guess.before - guess.after) for guess in coarse.guesses if guess.kind == "order"]
    names = examination.evidence.rig.names
    moved = [v for v, camera in enumerate(coarse.state.cameras) if camera != v]
    if not gains or not moved:
        return ()
    said = ", ".join(f"view {names[v]!r} is of camera {names[coarse.state.cameras[v]]!r}" for v in moved)
    order = " ".join(names[camera] for camera in coarse.state.cameras)
    sentence = f"Cameras are in another order than their calibrations: {said}."
    remedy = f"Rename them, or say so: --camera-order {order}"
    cameras = tuple(names[v] for v in moved)
    size = float(len(moved))
    return (
        Finding(
            Kind.ORDER, cameras, None, size, "views", np.nan, 0.97, 0.5 * len(moved) * sum(gains), sentence, remedy
        ),
    )
