"""Public arrays have the documented order of axes: frame, view, person, keypoint; or the view last (conventions)."""

import inspect
import re
from collections.abc import Iterator
from dataclasses import fields
from itertools import pairwise

import numpy as np

import posefuse
from posefuse.model.reconstruction import Layer

from ..conftest import ROOT
from ..people import simulate_walkers, track_perfectly

AXES = ("frame", "view", "person", "keypoint")
VIEW_LAST = ("view_status", "view_error_px", "detection", "rows")
"""Arrays of persons or points with one number per view, and the method that returns one."""


def described_shapes() -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Yield owner, attribute or argument, and axes of each shape that public docstrings state."""
    for name in posefuse.__all__:
        owner = getattr(posefuse, name)
        members = [owner, *vars(owner).values()] if inspect.isclass(owner) else [owner]
        for member in members:
            text = inspect.getdoc(getattr(member, "__func__", member)) or ""
            for line in re.finditer(r"(?im)^(?:\s*(\w+): )?[^\n]*?shape \(([^)]*)\)", text):
                yield (
                    name,
                    line[1] or getattr(member, "__name__", ""),
                    tuple(axis.strip() for axis in line[2].split(",")),
                )


def test_docstrings_state_the_documented_order():
    described = [entry for entry in described_shapes() if len([axis for axis in entry[2] if axis in AXES]) > 1]
    assert len(described) > 30
    wrong = []
    for owner, name, axes in described:
        known = [axis for axis in axes if axis in AXES]
        places = [AXES.index(axis) for axis in known[:-1]] if name in VIEW_LAST else [AXES.index(a) for a in known]
        ordered = all(a <= b for a, b in pairwise(places))  # a covariance repeats an axis
        if not ordered or (name in VIEW_LAST and axes[-1] != "view"):
            wrong.append(f"{owner}.{name}: {axes}")
    assert wrong == []
    conventions = (ROOT / "docs" / "conventions.md").read_text("utf-8")
    assert [name for name in VIEW_LAST[:3] if f"`{name}`" not in conventions] == []


def test_arrays_have_the_documented_axes():
    scene = simulate_walkers()
    result = track_perfectly(scene)
    size = {
        "frame": result.n_frames,
        "view": len(result.rig),
        "person": len(result.person_ids),
        "keypoint": len(result.skeleton),
    }
    assert len(set(size.values())) == 4, "lengths must differ to tell axes apart"
    f, v, p, k = size.values()
    for layer in result.layers.values():
        for field in fields(Layer):
            tail = {"points_m": (3,), "covariance_m2": (6,), "view_status": (v,), "view_error_px": (v,)}
            assert np.shape(getattr(layer, field.name)) == (f, p, k, *tail.get(field.name, ()))
        assert layer.n_views.shape == layer.has_point.shape == (f, p, k)
        assert layer.sd_m.shape == (f, p, k, 3)
        assert result.rig.project(np.asarray(layer.points_m)).shape == (f, v, p, k, 2)
    assert result.tracks is not None
    assert np.shape(result.tracks.detection) == (f, p, v)
    assert np.shape(result.tracks.state) == (f, p)
    assert result.tracks.rows(scene.detections).shape == (f, p, v)
    assert result.retimed.shape == scene.detections.people_counts.shape == (f, v)
    paired = posefuse.people_points(result, result)
    assert paired.points_m.shape == paired.truth_m.shape == (f, p, k, 3)
    single = posefuse.Detections.from_dense(result.skeleton, result.rig.names, np.zeros((f, v, k, 2)))
    assert [array.shape for array in single.dense()] == [(f, v, k, 2), (f, v, k)]
