"""Were a view's images turned, mirrored or resized after its camera was calibrated?"""

from typing import TYPE_CHECKING

import numpy as np

from posefuse.diagnostics.findings import Finding, Kind
from posefuse.diagnostics.state import Image

if TYPE_CHECKING:
    from posefuse.diagnostics.examine import Examination

_TURNS = {1: "a quarter turn clockwise", 2: "upside down", 3: "a quarter turn anticlockwise"}


def find(examination: "Examination") -> tuple[Finding, ...]:
    """Views whose images are not as they were calibrated."""
    coarse = examination.coarse
    if coarse is None or not coarse.agreed:
        return ()
    gains = {guess.view: 400.0 * (guess.before - guess.after) for guess in coarse.guesses if guess.kind == "image"}
    names = examination.evidence.rig.names
    if -1 in gains:
        return (_finding((), coarse.state.images[0], gains[-1], 1.0),)
    state = coarse.state if examination.fine is None else examination.fine.last.state
    return tuple(
        _finding((names[v],), coarse.state.images[v], gain, float(state.focal[0, v].mean()))
        for v, gain in sorted(gains.items())
        if coarse.state.images[v] != Image()
    )


def _finding(cameras: tuple[str, ...], image: Image, gain: float, focal: float) -> Finding:
    done = []
    if image.mirrored:
        done.append("mirrored")
    if image.turns:
        done.append(_TURNS[image.turns])
    if image.scale != 1.0:
        done.append(f"resized to {image.scale * focal:.3g} times the size")
    who = f"The images of view {cameras[0]!r}" if cameras else "The images of all views"
    sentence = f"{who} are not as they were calibrated: {', '.join(done)}."
    remedy = "Detect on images like those of the calibration, or calibrate for the images you have."
    size, unit = (image.scale, "times") if image.scale != 1.0 else (90.0 * image.turns, "deg")
    return Finding(Kind.IMAGE, cameras, None, float(size), unit, np.nan, 0.97, 0.5 * gain, sentence, remedy)
