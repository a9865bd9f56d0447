"""Remake a page of docs: run its commands, replace what they print, and take its pictures.

    python docs/remake.py                                         docs/gallery.md
    python docs/remake.py docs/brighton.md --home DIR             DIR holds the photos, as brighton/

A block that begins with ``$ `` is a transcript: each such line is run, and what follows it becomes
what it prints, to both streams. ``$ export A=B`` holds for the rest of the page. A comment
``picture`` above an image says what it is taken of::

    <!-- picture: figure recall.png -->                       a file that a command drew
    <!-- picture: latex airzoo-bench table ... -->            the typeset page of what it prints
    <!-- picture: html airzoo-bench table ... -->             what it prints, in a browser
    <!-- picture: page report.html #part1-summary 1000 -->    an element of a page, so many px wide
    <!-- picture: page report.html#part1-map=x #part1-map 1000 -->    of the page at an address

Needs pdflatex, pdftoppm, chromium and chromedriver, and Selenium.
"""

from __future__ import annotations

import argparse
import base64
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image, ImageChops, ImageOps

DOCS = Path(__file__).resolve().parent
NEEDED = ("airzoo-bench", "pdflatex", "pdftoppm", "chromium", "chromedriver")
FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars")
TRANSCRIPT = re.compile(r"^```\n(\$ .*?)^```$", re.MULTILINE | re.DOTALL)
PICTURE = re.compile(
    r"<!-- picture: (\w+) (.+?) -->\n!\[[^\]]*\]\((images/gallery-[\w-]+\.(?:png|jpg))\)"
)
# What a slow machine says besides.
TIME_LEFT = re.compile(r"(, about \d+ \w+ left| \.\.\.)$")
SCREEN_PX, BORDER_PX, MOST_BYTES = 1000, 12, 120_000


def run(command: str, home: Path, *, may_find: bool = False) -> str:
    """Return what a shell command prints in a folder; exit code 1 may be an audit's finding."""
    if command.startswith("export "):
        os.environ.update(dict(pair.split("=", 1) for pair in shlex.split(command)[1:]))
    done = subprocess.run(
        command,
        shell=True,
        cwd=home,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    if done.returncode > may_find:
        sys.exit(f"$ {command}\n{done.stdout}exit code {done.returncode}")
    lines = (line.rstrip() for line in done.stdout.splitlines() if not TIME_LEFT.search(line))
    return "".join(f"{line}\n" for line in lines)


def transcript(block: str, home: Path) -> str:
    """Return a block with its commands and what they print now."""
    commands = [line for line in block.splitlines() if line.startswith("$ ")]
    printed = [run(command[2:], home, may_find=True).strip("\n") for command in commands]
    parts = [f"{c}\n{p}".rstrip() for c, p in zip(commands, printed, strict=True)]
    return "\n\n".join(parts).replace(str(home), "~") + "\n"


def typeset(command: str, home: Path) -> Image.Image:
    """Return the pages that the LaTeX printed by a command gives, one below the other."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "table.tex").write_text(run(command, home), encoding="utf-8")
        run("pdflatex -interaction=batchmode -halt-on-error table.tex", folder)
        run("pdftoppm -r 110 -png table.pdf page", folder)
        pages = [trimmed(Image.open(path)) for path in sorted(folder.glob("page-*.png"))]
    width, height = max(page.width for page in pages), sum(page.height for page in pages)
    whole = Image.new("RGB", (width, height), "white")
    top = 0
    for page in pages:
        whole.paste(page, (0, top))
        top += page.height
    return whole


def trimmed(image: Image.Image) -> Image.Image:
    """Return a picture with an even, narrow margin."""
    image = image.convert("RGB")
    empty = Image.new("RGB", image.size, "white")
    box = ImageChops.difference(image, empty).getbbox()
    return ImageOps.expand(image.crop(box), BORDER_PX, "white")


@contextmanager
def opened(page: str, width: int) -> Iterator[Any]:
    """Open an address in a browser whose window is so many px wide."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for flag in FLAGS:
        options.add_argument(flag)
    driver = webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))
    try:
        size = {"width": width, "height": SCREEN_PX, "deviceScaleFactor": 1, "mobile": width < 600}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        driver.get(page)
        drawn = "return Promise.all([...document.images].map((i) => i.decode().catch(() => null)))"
        driver.execute_script(drawn)
        time.sleep(1)  # maps are drawn after the page
        yield driver
    finally:
        driver.quit()


def screenshot(page: str, selector: str, width: int) -> Image.Image:
    """Return an element of a page, or its upper part where it is higher than a screen."""
    with opened(page, width) as driver:
        element = driver.find_element("css selector", selector)
        driver.execute_script("arguments[0].scrollIntoView()", element)
        box = driver.execute_script(
            "const r = arguments[0].getBoundingClientRect();"
            "return {x: r.x + scrollX, y: r.y + scrollY, width: r.width, height: r.height}",
            element,
        )
        box |= {"height": min(box["height"], SCREEN_PX), "scale": 1}
        asked = {"clip": box, "captureBeyondViewport": True}
        content = driver.execute_cdp_cmd("Page.captureScreenshot", asked)["data"]
    return Image.open(io.BytesIO(base64.b64decode(content)))


def taken(kind: str, what: str, home: Path) -> Image.Image:
    """Return the picture that a comment asks for."""
    if kind == "figure":
        return Image.open(home / what)
    if kind == "latex":
        return typeset(what, home)
    if kind == "html":
        page = home / "table.html"
        page.write_text(f"<!DOCTYPE html><meta charset=utf-8>{run(what, home)}", encoding="utf-8")
        return screenshot(page.as_uri(), "body", 800)
    address, selector, width = what.split()
    file, sign, place = address.partition("#")
    return screenshot((home / file).as_uri() + sign + place, selector, int(width))


def keep(image: Image.Image, path: Path) -> None:
    """Write a picture without its empty margin, a drawing in as few colours as keep it small."""
    image = trimmed(image)
    if path.suffix == ".jpg":
        image.save(path, quality=75, optimize=True)
        return
    for colours in (128, 64, 32, 16):
        image.quantize(colours, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size <= MOST_BYTES:
            return
    sys.exit(f"{path}: more than {MOST_BYTES} bytes; ask for less of the page")


def main() -> None:
    """Remake a page; what an earlier run has made is used where a folder is named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("page", type=Path, nargs="?", default=DOCS / "gallery.md")
    parser.add_argument("--home", type=Path, help="where to work (default: a temporary folder)")
    parser.add_argument("--text", action="store_true", help="leave the pictures as they are")
    asked = parser.parse_args()
    needed = NEEDED[:1] if asked.text else NEEDED
    missing = [name for name in needed if shutil.which(name) is None]
    if missing:
        sys.exit(f"not installed: {', '.join(missing)}")
    os.environ["COLUMNS"] = "80"
    with tempfile.TemporaryDirectory() as made:
        home = (asked.home or Path(made)).resolve()
        home.mkdir(parents=True, exist_ok=True)
        text = asked.page.read_text(encoding="utf-8")
        text = TRANSCRIPT.sub(lambda block: f"```\n{transcript(block[1], home)}```", text)
        asked.page.write_text(text, encoding="utf-8")
        for kind, what, file in [] if asked.text else PICTURE.findall(text):
            keep(taken(kind, what, home), DOCS / file)


if __name__ == "__main__":
    main()
