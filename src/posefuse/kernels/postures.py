"""How people hold themselves: how upright they are, and how far each segment and bone leans from the trunk."""

from posefuse.kernels.jit import kernel


@kernel
def note_leans(turns, bones, firm, dt_s, memory_s, looked_s, leans, variance, upright):
    """Means over the last ``memory_s`` of how people lean who are well seen; of all there was at first.

    Args:
        turns: shape (person, segment, 3, 3); the first segment is the trunk, its third axis is up.
        bones: shape (person, bone, 3, 3).
        firm: shape (person,), bool: who is well seen.
        dt_s: since the last frame.
        memory_s: over what time.
        looked_s: shape (person,), in and out: for how long they have been well seen.
        leans: shape (person, segment + bone), in and out: cosines between third axes and the trunk's.
        variance: shape (person, segment + bone), in and out: of these cosines over time.
        upright: shape (person, 3), in and out: the trunk's third axis.
    """
    segments = turns.shape[1]
    for p in range(firm.shape[0]):
        if not firm[p]:
            continue
        looked_s[p] += dt_s
        share = max(dt_s / memory_s, dt_s / looked_s[p]) if looked_s[p] > 0.0 else 1.0
        share = min(share, 1.0)
        x, y, z = turns[p, 0, 0, 2], turns[p, 0, 1, 2], turns[p, 0, 2, 2]
        upright[p, 0] += share * (x - upright[p, 0])
        upright[p, 1] += share * (y - upright[p, 1])
        upright[p, 2] += share * (z - upright[p, 2])
        for i in range(leans.shape[1]):
            axes = turns[p, i] if i < segments else bones[p, i - segments]
            off = axes[0, 2] * x + axes[1, 2] * y + axes[2, 2] * z - leans[p, i]
            leans[p, i] += share * off
            variance[p, i] += share * ((1.0 - share) * off * off - variance[p, i])
