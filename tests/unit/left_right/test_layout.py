"""Layouts of skeletons."""

import numpy as np

from posefuse.left_right.layout import Layout
from posefuse.skeleton.skeletons import find_skeleton


class TestLayout:
    def test_chains_and_links_of_a_human(self):
        skeleton = find_skeleton("halpe_26")
        layout = Layout.of(skeleton)
        names = [left[5:] for left, _ in skeleton.pairs]
        assert layout.chains == ("face", "arm", "leg")
        assert [len(block) for block in layout.blocks] == [2, 3, 6]
        bones = {(names[a], names[b]) for a, b in layout.links}
        assert {("hip", "knee"), ("knee", "ankle"), ("shoulder", "hip")} <= bones
        assert [names[p] for p in np.flatnonzero(layout.trunk)] == ["eye", "shoulder", "hip"]
        assert len(layout.facing) == 3

    def test_long_chains_are_split(self):
        layout = Layout.of(find_skeleton("coco_wholebody_133"))
        assert max(len(block) for block in layout.blocks) == 6
        assert sorted(np.concatenate(layout.blocks)) == list(range(len(layout.chain_of)))
        assert len(layout.chains) == len(set(layout.chains))
