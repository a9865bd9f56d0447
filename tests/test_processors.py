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

from tests import processor_truths

X86 = pytest.mark.skipif(
    platform.machine() != "x86_64" or sys.platform != "linux", reason="switches of x86-64 and glibc"
)
pytestmark = [X86, pytest.mark.slow]

_VECTORS = " ".join(name for name in __cpu_dispatch__ if __cpu_features__.get(name))
PROCESSORS = {
    "Haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "Nehalem": {"OPENBLAS_CORETYPE": "Nehalem", "OPENBLAS_NUM_THREADS": "4"},
    "no vectors": {
        "NPY_DISABLE_CPU_FEATURES": _VECTORS,
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,-AVX512F",
    },
}
if __cpu_features__.get("AVX512F"):
    PROCESSORS["SkylakeX"] = {"OPENBLAS_CORETYPE": "SkylakeX", "OPENBLAS_NUM_THREADS": "1"}


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


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> str:
    found = processor_truths.flights(tmp_path_factory.mktemp("here"))
    return "".join(f"{name} {value}\n" for name, value in found.items())


@pytest.mark.parametrize("processor", list(PROCESSORS))
def test_flights(processor: str, flights: str, tmp_path: Path) -> None:
    assert flights.count("\n") == 4
    assert made_on(processor, "flights", tmp_path / "f") == flights


@pytest.mark.parametrize("processor", ["Nehalem", "no vectors"])
def test_real_photos(processor: str, brighton: Path, tmp_path: Path) -> None:
    here = made_on("this one", "photos", tmp_path / "here", brighton)
    assert here.count("\n") == 3
    assert made_on(processor, "photos", tmp_path / "there", brighton) == here


@pytest.mark.parametrize("processor", list(PROCESSORS))
def test_airzoo_mini(processor: str, tmp_path: Path) -> None:
    here = made_on("this one", "mini", tmp_path / "here")
    assert made_on(processor, "mini", tmp_path / "there") == here
