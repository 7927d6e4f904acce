"""Whether everything on an open page is seen whole: no table, box of code or picture is cut off or empty."""

from __future__ import annotations

import base64
import io
import json
from typing import Any

import chromium
import numpy as np
from PIL import Image

# What stands in a box that scrolls is cut: a reader of a still page does not see it, unless the box itself shows that there is
# more.  Two frames are waited for, in which a page of a report fits its tables to its width.  Plotly measures texts far outside
# of the page.
CUT = """(async marked => {
  if (document.querySelector('.scroll')) for (const _ of [1, 2]) await new Promise(requestAnimationFrame);
  const found = [], LEAST = 8; // [px]
  const name = one => `${one.tagName.toLowerCase()} ${one.getAttribute('class') || one.id}: `
    + (one.getAttribute('src') || one.textContent).trim().replace(/\\s+/g, ' ').slice(-40);
  const hidden = '.hidden, [aria-hidden=true], button, label, #js-plotly-tester';
  for (const one of document.querySelectorAll('table, pre, img, svg, canvas, iframe[src], .plot')) {
    if (!one.checkVisibility({ checkVisibilityCSS: true }) || one.closest(hidden)) continue;
    if (one.parentElement.closest('svg, .plot')) continue;
    const box = one.getBoundingClientRect();
    if (box.width < LEAST || box.height < LEAST) { found.push(`empty: ${name(one)}`); continue; }
    if (one.matches('img') && !one.naturalWidth) found.push(`not loaded: ${name(one)}`);
    if (one.matches('.plot') && !one.querySelector('svg')) found.push(`not drawn: ${name(one)}`);
    if (marked && one.closest(marked)) continue;
    let left = 0, right = document.documentElement.clientWidth;
    for (let outer = one.parentElement; outer; outer = outer.parentElement) {
      if (getComputedStyle(outer).overflowX === 'visible') continue;
      const edge = outer.getBoundingClientRect();
      left = Math.max(left, edge.left); right = Math.min(right, edge.right);
    }
    const within = one.matches('pre') ? one.scrollWidth - one.clientWidth : 0;
    const over = Math.round(Math.max(left - box.left, box.right - right, within));
    if (over > 1) found.push(`cut by ${over} px: ${name(one)}`);
    const parts = one.matches('svg') ? Array.from(one.querySelectorAll('path, text, rect'))
      .filter(p => p.getClientRects().length).map(p => p.getBoundingClientRect()) : [];
    const outside = p => p.left < box.left - 2 || p.right > box.right + 2 || p.top < box.top - 2 || p.bottom > box.bottom + 2;
    if (parts.some(outside)) found.push(`reaches out of its frame: ${name(one)}`);
  }
  return found;
})"""


IMAGES = """Array.from(document.querySelectorAll('article img'), one => {
  const { left, top, width, height } = one.getBoundingClientRect();
  return [one.getAttribute('src'), { x: left + scrollX, y: top + scrollY, width, height, scale: 1 }];
})"""


def list_cut(page: chromium.Browser, marked: str = "") -> Any:
    """List what is cut or empty on an open page [list of str].

    marked : selector of boxes that scroll and show that there is more
    """
    return page.evaluate(f"{CUT}({json.dumps(marked)})")


def measure_pictures(page: chromium.Browser) -> dict[str, tuple[float, float]]:
    """Measure how light the pictures of an open page are as they are seen: mean and spread, 0 black, 1 white [-]."""
    found = {}
    for source, clip in page.evaluate(IMAGES):
        data = page.call("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)["data"]
        with Image.open(io.BytesIO(base64.b64decode(data))) as image:
            grey = np.asarray(image.convert("L"), dtype=float) / 255.0
        found[source] = (float(grey.mean()), float(np.ptp(grey)))
    return found
