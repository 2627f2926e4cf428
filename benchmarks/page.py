"""Benchmark of the explorer in a real browser: bytes, ready, a brush that redraws all views, and hover, at three sizes.

    python benchmarks/page.py --out FILE

Prints one JSON line a front (of 5 criteria and a duration, made by a seed): bytes of the file and of its script; when
the page is ready, ms after it began to load; what drawing takes at each frame of brushes that are dragged, and at each
move of the mouse over axes, map, pairs and table, where finding the row is included: median and 95th percentile, ms on
the clock; and the processor's ms a frame, of the whole process that draws, which others at work hardly change.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import seeded_fronts
from playwright.sync_api import Browser, Page, sync_playwright

from hpop.view import save_explorer
from hpop.view.single_page import bundle

SIZES = (158, 3_290, 8_000)
CRITERIA = 5
MOVES = 60  # of a brush over three axes, and of the mouse over each view
BROWSER = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
FRAMES = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
READY = "new Promise(done => { const look = () => window.hpop ? done() : requestAnimationFrame(look); look(); })"
# Moves over a view: the event's own time, in which the row is found, and that of the overlays drawn after it.
HOVER = """async ([selector, shares]) => {
  const element = document.querySelector(selector);
  const box = element.getBoundingClientRect();
  const { overlay } = window.hpop.counters;
  const times = [];
  for (const [across, down] of shares) {
    const [clientX, clientY] = [box.left + across * box.width, box.top + down * box.height];
    const drawn = overlay.length;
    const at = document.elementFromPoint(clientX, clientY) ?? element;
    const begin = performance.now();
    const how = { clientX, clientY, bubbles: true, pointerType: "mouse", movementX: 1 };
    at.dispatchEvent(new PointerEvent("pointerenter", { ...how, bubbles: false }));
    at.dispatchEvent(new PointerEvent("pointermove", how));
    const found = performance.now() - begin;
    await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
    times.push(found + overlay.slice(drawn).reduce((sum, ms) => sum + ms, 0));
  }
  return times;
}"""


def processor(browser: Browser) -> float:
    """Seconds that the processes which draw pages have taken of the processor."""
    session = browser.new_browser_cdp_session()
    found = session.send("SystemInfo.getProcessInfo")["processInfo"]
    session.detach()
    return float(sum(process["cpuTime"] for process in found if process["type"] == "renderer"))


def brushed(page: Page, axis: int) -> None:
    """Drag a brush open along an axis, then move it."""
    box = page.locator(".strip").nth(axis).bounding_box()
    assert box is not None
    x = box["x"] + box["width"] / 2
    for begin, end in ((0.95, 0.35), (0.6, 0.3)):
        page.mouse.move(x, box["y"] + begin * box["height"])
        page.mouse.down()
        for share in np.linspace(begin, end, MOVES // 6):
            page.mouse.move(x, box["y"] + share * box["height"])
            page.evaluate(FRAMES)
        page.mouse.up()


def spread(times: list[float]) -> dict[str, float]:
    """Median and 95th percentile, ms."""
    return {"median_ms": round(float(np.median(times)), 2), "p95_ms": round(float(np.percentile(times, 95)), 2)}


def measured(browser: Browser, path: Path, rows: int) -> dict[str, Any]:
    """One page, opened twice: the first opening also loads the browser's own code."""
    for _ in range(2):
        page = browser.new_context(viewport={"width": 1440, "height": 900}).new_page()
        page.goto(path.as_uri())
        page.evaluate(READY)
        ready = float(page.evaluate("hpop.counters.ready"))
    before, first = processor(browser), page.evaluate("hpop.counters.base.length")
    for axis in (0, 2, 4):
        brushed(page, axis)
    redraws = page.evaluate(f"hpop.counters.base.slice({first})")
    seconds = processor(browser) - before
    rng = np.random.default_rng(0)
    hover: list[float] = []
    for selector in (".axes-plot", ".map .plot", ".matrix .plot", ".grid"):
        shares = rng.uniform(0.05, 0.95, size=(MOVES, 2)).tolist()
        hover += page.evaluate(HOVER, [selector, shares])
    return {
        "rows": rows,
        "file_bytes": path.stat().st_size,
        "script_bytes": len(bundle("explorer.js").encode()),
        "ready_ms": round(ready),
        "redraws": len(redraws),
        "redraw": {**spread(redraws), "processor_ms": round(1000 * seconds / len(redraws), 2)},
        "hovers": len(hover),
        "hover": spread(hover),
    }


def machine(browser: Browser) -> dict[str, Any]:
    """Describe the machine and the browser."""
    text = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    names = [line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")]
    return {
        "processor": names[0] if names else platform.machine(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1),
        "browser": f"chromium {browser.version}, no GPU",
    }


def main() -> None:
    """Open the page of each size and measure it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/bench/page.json"), help="JSON file")
    arguments = parser.parse_args()
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        raise SystemExit("expected chromium, found none: apt-get install chromium")
    problem = seeded_fronts.problem(CRITERIA)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=BROWSER)
        on = machine(browser)
        print(json.dumps(on))
        pages = []
        for rows in SIZES:
            front = seeded_fronts.front(rows, CRITERIA, of=problem)
            path = save_explorer(problem, front, Path(folder) / f"{rows}.html")
            pages.append(measured(browser, path, len(front)))
            print(json.dumps(pages[-1]))
        browser.close()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps({"machine": on, "pages": pages}, indent=1) + "\n")


if __name__ == "__main__":
    main()
