"""Lengths of descriptors: what they do to rankings is said, and what no method does is refused."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import UserError
from tests.readers.retrieval_support import Place, perfect, scored
from tests.readers.samples import game4loc


def scaled(folder: Path, queries: float, tiles: float) -> Path:
    """Write Game4Loc's features, with queries and every other tile that much longer."""
    path = game4loc.write(folder, Place())
    arrays = dict(np.load(path))
    arrays["query_features"] *= queries
    arrays["gallery_features"][::2] *= tiles
    np.savez(path, **arrays)
    return path


def test_tiles_of_several_lengths_are_said(tmp_path: Path, home: Path) -> None:
    notes = scored(scaled(tmp_path, 3, 1.5), home).result.notes
    assert any("ranks by inner product, the protocol by L2" in note for note in notes)
    assert any("of tiles are 1 to 1.5 long" in note for note in notes)


def test_the_length_of_queries_turns_no_ranking(tmp_path: Path, home: Path) -> None:
    result = scored(scaled(tmp_path, 3, 1), home)
    assert perfect(result)
    assert not any("another than the method's own" in note for note in result.result.notes)


def test_tiles_that_were_kept_before_they_were_normalised(tmp_path: Path, home: Path) -> None:
    with pytest.raises(UserError, match=r"of the gallery are 1 to 1\.5 long"):
        scored(scaled(tmp_path, 1, 1.5), home)


def test_a_signalling_nan_is_refused_without_a_warning(tmp_path: Path, home: Path) -> None:
    path = scaled(tmp_path, 1, 1)
    arrays = dict(np.load(path))
    for name in ("query_features", "gallery_features"):
        arrays[name].view(np.uint32)[0, 0] = 0x7F800001
    np.savez(path, **arrays)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(UserError, match="NaN or infinite descriptors: 1 of"):
            scored(path, home)
