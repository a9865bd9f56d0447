"""AirZoo-Mini, as the tests of this folder see it."""

from __future__ import annotations

import pytest

from tests.datasets.mini.prepared import Prepared, prepared


@pytest.fixture(scope="session")
def mini(tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    return prepared(tmp_path_factory)
