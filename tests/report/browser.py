"""A page in a real Chromium, and short ways to ask it.

Who imports it is skipped where Selenium is not installed (Debian: chromium and chromium-driver;
PyPI: selenium).
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from typing import Any

import pytest

from tests.support import HANGS_S

webdriver = pytest.importorskip("selenium.webdriver", reason="no Selenium: pip install selenium")


BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
NEEDS_CHROMIUM = pytest.mark.skipif(
    BROWSER is None or DRIVER is None, reason="no Chromium: apt install chromium chromium-driver"
)
FLAGS = (
    *("--headless=new", "--no-sandbox", "--no-first-run", "--window-size=1280,900"),
    *("--disable-gpu", "--disable-quic", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
)


class Opened:
    """A page in the browser, and short ways to ask it."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def all(self, selector: str) -> list[Any]:
        return list(self.driver.find_elements("css selector", selector))

    def one(self, selector: str) -> Any:
        return self.driver.find_element("css selector", selector)

    def button(self, inside: str, text: str) -> Any:
        return next(b for b in self.all(f"{inside} button") if b.text.startswith(text))

    def choose(self, inside: str, label: str, option: str) -> None:
        for node in self.all(f"{inside} label"):
            if node.text.startswith(label):
                found = node.find_elements("css selector", "option")
                next(o for o in found if o.text == option).click()
                return
        raise AssertionError(label)

    def until(self, asked: Callable[[], Any]) -> Any:
        end = time.monotonic() + HANGS_S
        while time.monotonic() < end:
            if found := asked():
                return found
            time.sleep(0.02)
        raise AssertionError("waited in vain")

    def column(self, inside: str, number: int) -> list[str]:
        cells = self.all(f"{inside} tbody tr:not(.floor) > :nth-child({number})")
        return [
            cell.text.split("\n")[0].removesuffix(" (best)").removesuffix(" ‡") for cell in cells
        ]

    def rows(self) -> list[str]:
        return [row.text for row in self.all("#part1-queries .listed tbody th")]

    def status(self, inside: str) -> str:
        return str(self.one(f"{inside} [role=status]").text)

    def pixels(self) -> Any:
        return self.driver.execute_script("return document.querySelector('canvas').toDataURL()")

    def titles(self, inside: str) -> list[str]:
        return [head.text for head in self.all(f"{inside} h4")[:1]]

    def go(self, address: str) -> None:
        self.driver.execute_script("location.hash = arguments[0]", address)

    def press(self, *keys: str) -> None:
        webdriver.ActionChains(self.driver).send_keys(*keys).perform()
