"""A truth has one fingerprint, whatever the processor it was made on.

Libraries choose their routines by the processor: OpenBLAS its kernels, NumPy its vectors, the C
library its fused multiply-add. Each can be told to act as on an older one.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

other = platform.machine() != "x86_64" or sys.platform != "linux"
pytestmark = [pytest.mark.skipif(other, reason="switches of x86-64 and glibc"), pytest.mark.slow]

_VECTORS = " ".join(name for name in __cpu_dispatch__ if __cpu_features__.get(name))
PROCESSORS = {
    "Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "Nehalem": {"OPENBLAS_CORETYPE": "Nehalem", "OPENBLAS_NUM_THREADS": "4"},
    "no vectors": {
        "NPY_DISABLE_CPU_FEATURES": _VECTORS,
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,-AVX512F",
    },
}


def made_on(processor: str, *arguments: object) -> str:
    wanted = PROCESSORS.get(processor, {})
    done = subprocess.run(
        [sys.executable, "-m", "tests.processor_truths", *map(str, arguments)],
        cwd=Path(__file__).parent.parent,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)} | wanted,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("processor", ["Nehalem", "no vectors"])
def test_real_photos(processor: str, brighton: Path, tmp_path: Path) -> None:
    here = made_on("this one", "photos", tmp_path / "here", brighton)
    assert here.count("\n") == 3
    assert made_on(processor, "photos", tmp_path / "there", brighton) == here


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> str:
    return made_on("this one", "mini", tmp_path_factory.mktemp("here") / "data")


@pytest.mark.parametrize("processor", list(PROCESSORS))
def test_airzoo_mini(processor: str, here: str, tmp_path: Path) -> None:
    assert made_on(processor, "mini", tmp_path / "there") == here
