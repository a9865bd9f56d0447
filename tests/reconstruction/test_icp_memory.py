"""ICP holds a sample of the prediction and parts of the truth, measured in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys

CHILD = """
import resource
import numpy as np
from airzoo_bench.reconstruction.alignment.icp import IcpSettings, refine
from airzoo_bench.formats.clouds.cloud import Cloud

class Made:
    def __init__(self, count, lift):
        self.count, self.lift = count, lift
    def pieces(self, points):
        for start in range(0, self.count, points):
            n = np.arange(start, min(start + points, self.count), dtype=float)
            x, y = n % 2003 * 0.1, n // 2003 * 0.1
            yield Cloud(np.stack((x, y, 3 * np.sin(x / 7) + self.lift), axis=1))

settings = IcpSettings(20_000, 2.0, 2, 1e-9, True, 0)
def peak(count):
    refine(Made(count, 0.3), Made(count, 0.0), settings, held_points=100_000)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
few = peak(300_000)
print(peak(2_000_000) - few)
"""


def test_icp_of_large_clouds_takes_no_more_than_of_small_ones() -> None:
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", CHILD], capture_output=True, text=True, check=True, env=environment
    )
    # Both clouds are 92 MB.
    assert int(done.stdout) < 24 * 1024
