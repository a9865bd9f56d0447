"""Write the true answers of a prepared benchmark, which score R@1 100 or a median of 0.00 m.

Run ``python perfect.py hills-retrieval perfect.npz``, and ``airzoo-bench eval retrieval`` on that.
"""

import sys

import airzoo_bench as ab
from airzoo_bench.core.files import data_root
from airzoo_bench.evaluation.predictions import read_truths
from airzoo_bench.protocol.model import find_protocol

name, out = sys.argv[1:]
protocol = find_protocol(name, data_root())
_, truths = read_truths(protocol, data_root())  # which methods never see
with ab.PredictionWriter(out, name, ab.load_benchmark(protocol.benchmark)) as writer:
    for truth in truths:
        for row, query in enumerate(truth.queries["id"]):
            if protocol.track == "matching":
                rotation, centre = truth.poses.rotation[row], truth.poses.centres[row]
                writer.add(query, rotation=rotation, centre=centre)
            else:
                tiles = truth.tiles["id"].iloc[truth.positives.tiles_of(row)]
                writer.add(query, ranked_ids=tiles.tolist())
