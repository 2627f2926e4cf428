"""The explorer as a test drives it: what is selected now, brushes, keys, and waiting for a frame."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Page

import hpop
from hpop.base.arrays import BoolArray, FloatArray
from hpop.view.explorer import payload
from hpop.view.single_page import single_page

READY = "window.hpop !== undefined"
MOST_FRAMES = 1_800
FRAME = "new Promise(done => requestAnimationFrame(done))"


def written(problem: hpop.Problem, front: hpop.Front, path: Path) -> Path:
    """Write the page of a front to a file."""
    given = payload(problem, front, saved="out/front.json")
    path.write_text(single_page("explorer.js", given["title"], given), encoding="utf-8")
    return path


def until(page: Page, expression: str) -> None:
    """Wait, frame by frame, until an expression is true; playwright's own waiting needs eval, which pages forbid."""
    page.evaluate(
        f"""() => new Promise((done, fail) => {{
          let frames = 0;
          const look = () => ({expression}) ? done() : ++frames > {MOST_FRAMES} ? fail(Error("never true")) : ask();
          const ask = () => requestAnimationFrame(look);
          look();
        }})"""
    )


def fresh(page: Page) -> None:
    """As the page was opened: no bounds, pins or wishes, the order of axes and rows as the front has them."""
    until(page, READY)
    page.evaluate(
        """() => {
          const { state } = window.hpop;
          const filter = { bounds: new Map(), kept: null, order: null };
          const sort = { key: "row", down: false };
          const none = { flipped: new Set(), logs: new Set(), hidden: new Set(), wishes: new Map() };
          state.restore({ filter, pins: [], order: [], sort, ...none });
          state.hover([]);
          state.last = null;
          document.activeElement?.blur();
        }"""
    )
    until(page, "location.hash === ''")


def pixels(page: Page, canvas: str) -> FloatArray:
    """Red, green, blue and opacity of all of a canvas (height, width, 4), which come as bytes: a list takes seconds."""
    js = """e => {
      const seen = e.getContext('2d').getImageData(0, 0, e.width, e.height);
      let bytes = '';
      for (let at = 0; at < seen.data.length; at += 8192)
        bytes += String.fromCharCode(...seen.data.subarray(at, at + 8192));
      return [e.width, e.height, btoa(bytes)];
    }"""
    width, height, data = page.eval_on_selector(canvas, js)
    return np.frombuffer(base64.b64decode(data), np.uint8).astype(np.float64).reshape(height, width, 4)


def state(page: Page, expression: str) -> Any:
    """Evaluate an expression of the page's state ``s`` after its next frame."""
    page.evaluate(FRAME)
    return page.evaluate(f"(s => {expression})(window.hpop.state)")


def selected(page: Page) -> BoolArray:
    """Return a mask (n,) of the rows that the page selects."""
    return np.array([letter == "1" for letter in state(page, "s.selected.join('')")], dtype=np.bool_)


def bounds(page: Page) -> dict[str, tuple[float, float]]:
    """Bounds by column, as the page holds them."""
    found = state(page, "[...s.filter.bounds].map(([i, b]) => [s.column(i).name, b.low, b.high])")
    return {name: (float(low), float(high)) for name, low, high in found}


def within(front: hpop.Front, asked: dict[str, tuple[float, float]]) -> BoolArray:
    """Rows (n,) whose costs in whole steps lie within bounds, by NumPy."""
    mask = np.ones(len(front), dtype=np.bool_)
    for name, (low, high) in asked.items():
        values: FloatArray
        if name in front.names:
            column = front.names.index(name)
            values, step = front.integers[:, column].astype(np.float64), float(front.quanta[column])
        else:
            values, step = front.reported[:, front.reported_names.index(name)], 1.0
        mask &= (values >= low / step * (1 - 1e-14)) & (values <= high / step * (1 + 1e-14))
    return mask


def brush(page: Page, name: str, begin: float, end: float) -> None:
    """Drag along the axis of a column, from one share of its height to another (0 below, 1 above)."""
    box = page.locator(f".axis[aria-label^='{name} '] .strip").bounding_box()
    assert box is not None
    x = box["x"] + box["width"] / 2
    y = [box["y"] + 8 + (1 - share) * (box["height"] - 16) for share in (begin, end)]
    page.mouse.move(x, y[0])
    page.mouse.down()
    page.mouse.move(x, sum(y) / 2)
    page.mouse.move(x, y[1])
    page.mouse.up()
    page.evaluate(FRAME)


def overlapping(page: Page, selector: str) -> list[tuple[str, str]]:
    """Pairs of elements whose boxes overlap by more than a pixel, of those that are seen."""
    boxes = page.eval_on_selector_all(
        selector,
        """all => all.map(e => [e.className || e.tagName, e.getBoundingClientRect()])
        .filter(([, b]) => b.width > 0 && b.height > 0)
        .map(([name, b]) => [name, b.left, b.top, b.right, b.bottom])""",
    )
    return [
        (a[0], b[0])
        for i, a in enumerate(boxes)
        for b in boxes[:i]
        if min(a[3], b[3]) - max(a[1], b[1]) > 1 and min(a[4], b[4]) - max(a[2], b[2]) > 1
    ]
