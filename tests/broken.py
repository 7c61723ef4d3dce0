"""Files as disks, transfers and hands break them."""

import numpy as np

_WORDS = (b"nan", b"1e999", b"null", b"true", b"-", b"[", b"{", b'"', b"99999999999999999999", b",,", b"1" + 400 * b"0")


def broken(original: bytes, rng: np.random.Generator) -> bytes:
    """Cut short, with bytes changed, doubled, left out or exchanged; once or a few times."""
    data = bytearray(original)
    for _ in range(rng.integers(1, 4)):
        if not data:
            break
        at, kind = int(rng.integers(len(data))), rng.integers(6)
        span = int(rng.integers(1, 30))
        if kind == 0:
            del data[at:]
        elif kind == 1:
            data[at] = rng.integers(256)
        elif kind == 2:
            data[at:at] = data[at : at + span]
        elif kind == 3:
            del data[at : at + span]
        elif kind == 4:
            word = _WORDS[rng.integers(len(_WORDS))]
            data[at : at + len(word)] = word
        else:
            other = int(rng.integers(len(data)))
            data[at : at + span], data[other : other + span] = data[other : other + span], data[at : at + span]
    return bytes(data)
