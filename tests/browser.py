"""Headless Chromium, for pages as people see them; where there is none, tests are skipped."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

NAMES = ("chromium", "chromium-browser", "google-chrome")

CONTRAST = """() => {
  const pixel = new OffscreenCanvas(1, 1).getContext("2d", {willReadFrequently: true});
  const parsed = color => {
    pixel.clearRect(0, 0, 1, 1);
    pixel.fillStyle = color;
    pixel.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = pixel.getImageData(0, 0, 1, 1).data;
    return [r, g, b, a / 255];
  };
  const over = (top, below) => [0, 1, 2].map(i => top[i] * top[3] + below[i] * (1 - top[3]));
  const channel = c => { c /= 255; return c <= .04045 ? c / 12.92 : ((c + .055) / 1.055) ** 2.4 };
  const luminance = ([r, g, b]) => .2126 * channel(r) + .7152 * channel(g) + .0722 * channel(b);
  const behind = e => e ? over(parsed(getComputedStyle(e).backgroundColor), behind(e.parentElement))
    : [255, 255, 255];
  const found = [];
  for (const e of document.querySelectorAll("main *")) {
    const own = [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim());
    if (!own || !e.checkVisibility() || e.closest(".unseen, svg title, style, option")) continue;
    const style = getComputedStyle(e);
    const both = [parsed(e.closest("svg") ? style.fill : style.color), behind(e)];
    const [a, b] = both.map(luminance).sort((x, y) => y - x);
    found.push([(a + .05) / (b + .05), e.textContent.trim().slice(0, 40)]);
  }
  return found;
}"""
"""The contrast of WCAG 2, of each text with what is behind it."""

NAMELESS = """() => [...document.querySelectorAll("input, select, button, a, iframe, svg, img")]
  .filter(e => e.type !== "hidden" && !e.ariaLabel && !e.labels?.length && !e.title && !e.alt &&
    !e.textContent.trim()).map(e => e.outerHTML)"""
"""What those who hear a page hear nothing of."""

CUT = """() => {
  const found = [], words = e => e.textContent.trim().slice(0, 40);
  for (const e of document.querySelectorAll("body *")) {
    if (!e.checkVisibility() || e.closest(".unseen, iframe")) continue;
    const {left, right} = e.getBoundingClientRect();
    const off = left < -1 || right > innerWidth + 1;
    if (right > left && off) found.push(`off the page: ${words(e)}`);
    const hides = getComputedStyle(e).overflowX !== "visible" && !e.closest("svg, input, select");
    if (hides && e.scrollWidth > e.clientWidth + 1) found.push(`behind an edge: ${words(e)}`);
  }
  for (const svg of document.querySelectorAll("svg")) {
    if (!svg.checkVisibility()) continue;
    const whole = (svg.closest("figure") ?? svg).getBoundingClientRect();
    const texts = [...svg.querySelectorAll("text")].map(t => [t, t.getBoundingClientRect()]);
    texts.forEach(([text, box], i) => {
      if (box.left < whole.left || box.right > whole.right) found.push(`too long: ${words(text)}`);
      for (const [other, its] of texts.slice(0, i))
        if (Math.min(box.right, its.right) - Math.max(box.left, its.left) > 1 &&
            Math.min(box.bottom, its.bottom) - Math.max(box.top, its.top) > 3)
          found.push(`on each other: ${words(text)}, ${words(other)}`);
    });
  }
  return found;
}"""
"""What a page hides at its edges, or writes over."""

LEAST = """() => Math.min(99, ...[...document.querySelectorAll("svg text")].map(text => {
  const svg = text.ownerSVGElement, width = svg.getBoundingClientRect().width;
  const size = parseFloat(getComputedStyle(text).fontSize);
  return width ? size * width / svg.viewBox.baseVal.width : 99;
}))"""
"""Size of the smallest letters in drawings [px]."""


def path() -> str:
    """The browser of this machine; without one the test is skipped."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip(f"there is no browser: {', '.join(NAMES)}")
    return found


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    """A browser without a window."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    executable = path()
    with api.sync_playwright() as playwright:
        arguments = ["--disable-gpu", *["--no-sandbox"] * (os.geteuid() == 0)]
        started = playwright.chromium.launch(executable_path=executable, args=arguments)
        yield started
        started.close()


@contextlib.contextmanager
def watched(page: Page, own: str) -> Iterator[Page]:
    """A page that nothing may go wrong on, and that asks nobody else.

    Args:
        page: a new one.
        own: what every address begins with that it may ask.
    """
    wrong: list[str] = []
    page.on("console", lambda m: wrong.append(m.text) if m.type in ("error", "warning") else None)
    page.on("pageerror", lambda e: wrong.append(str(e)))
    page.on("request", lambda r: None if r.url.startswith(own) else wrong.append(r.url))
    yield page
    page.close()
    assert not wrong
