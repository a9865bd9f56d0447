"""Every kind of page, on screens of several widths."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.report.browser import Opened

__all__ = ["KINDS", "TABLE", "screen", "visit"]

TABLE = "tables/airzoo-mini-retrieval/"
KINDS = [
    *("index.html", "downloads.html", "about.html"),
    *(f"{TABLE}{name}.html" for name in ("index", "ranks", "scores", "scenes", "scenes-2")),
    *(f"{TABLE}{name}.html" for name in ("scene-1", "conditions", "compare")),
    *(f"{TABLE}methods/{name}.html" for name in ("method-1", "reported-1", "floor-99")),
]


@contextmanager
def screen(page: Opened, width: int, scheme: str = "light", media: str = "") -> Iterator[None]:
    metrics = {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": width < 500}
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    page.driver.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"media": media, "features": features}
    )
    try:
        yield
    finally:
        page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})


def visit(page: Opened, address: Path) -> None:
    page.driver.get(address.as_uri())
    if address.name == "compare.html":
        page.until(lambda: page.all("#overall tbody tr"))
