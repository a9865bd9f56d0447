"""Run a command of airzoo-bench on workers that Slurm starts, and stop them when it has ended.

    python slurm.py --workers 16 --partition cpu -- \
        airzoo-bench eval retrieval preds.npz --data /shared/data --out /shared/results/mine

A worker is a job of one core. The scheduler runs where this script does: on a login node or, where
that is not welcome, in a job of its own (``sbatch --wrap "python slurm.py ..."``). The environment
of this Python, the predictions and the benchmark must lie on a file system that all nodes have.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from typing import Any

from dask_jobqueue import SLURMCluster


def main() -> int:
    """Start workers, run the command, and return how it ended."""
    asked = _arguments()
    settings: dict[str, Any] = {
        "queue": asked.partition,
        "account": asked.account,
        "cores": 1,
        "processes": 1,
        "memory": asked.memory,
        "walltime": asked.time,
        # A worker ends before its time is up, and hands back its tasks, rather than being killed.
        "worker_extra_args": ["--lifetime", asked.lifetime, "--lifetime-stagger", "2m"],
        "job_script_prologue": [
            "export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1",
            "export MALLOC_TRIM_THRESHOLD_=268435456 MALLOC_MMAP_THRESHOLD_=33554432",
        ],
        "interface": asked.interface,
    }
    with SLURMCluster(**settings) as cluster:
        sys.stderr.write(cluster.job_script())
        cluster.scale(jobs=asked.workers)
        engine = ["--engine", cluster.scheduler_address]
        return subprocess.run([*asked.command, *engine], check=False).returncode


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--workers", type=int, default=8, help="jobs of one core each")
    parser.add_argument("--partition", help="as for sbatch --partition")
    parser.add_argument("--account", help="as for sbatch --account")
    parser.add_argument("--memory", default="4GiB", help="of each worker")
    parser.add_argument("--time", default="02:00:00", help="as for sbatch --time")
    parser.add_argument("--lifetime", default="110m", help="a little less than --time")
    parser.add_argument("--interface", help="the network between nodes, such as ib0")
    parser.add_argument("command", nargs="+", help="after --: the command to run")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
