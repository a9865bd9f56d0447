"""The table of docs/benchmarks.md, made from what datasets say; run this to write it anew.

python -m tests.datasets.documented
"""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.core.registry import DATASETS
from airzoo_bench.protocol.model import load_protocol, shipped_protocols

PAGE = Path(__file__).parents[2] / "docs" / "benchmarks.md"
MARKER = "<!-- overview: made by tests/datasets/documented.py -->\n"
HEADER = """
| benchmark, where it is published | licence | protocol | scenes | queries |
| --- | --- | --- | --- | --- |
"""


def overview() -> str:
    """Return a row for each shipped protocol of the published benchmarks."""
    protocols = [load_protocol(path) for path in shipped_protocols().values()]
    rows = []
    for name in DATASETS.names():
        about = DATASETS.get(name).about
        if not about.is_published:
            continue
        first = f"[{about.title}]({about.page}) | {about.licence}"
        for protocol in (one for one in protocols if one.benchmark == name):
            counts = [scene.queries for scene in protocol.scenes if scene.queries is not None]
            queries = f"{sum(counts):,}" if counts else ""
            rows.append(f"| {first} | {protocol.name} | {len(protocol.scenes)} | {queries} |\n")
            first = " | "
    return HEADER + "".join(rows) + "\n"


if __name__ == "__main__":
    before, rest = PAGE.read_text(encoding="utf-8").split(MARKER)
    after = rest.split("<!-- end -->", 1)[1]
    PAGE.write_text(f"{before}{MARKER}{overview()}<!-- end -->{after}", encoding="utf-8")
