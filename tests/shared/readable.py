"""Whether a page can be read and used without a mouse: contrast of every text, names and focus of everything that acts."""

from __future__ import annotations

import json
from typing import Any

import chromium

# WCAG 2.2, AA: 4.5 : 1 for text, 3 : 1 for large text (24 px, or bold 18.66 px).  Colours are composed over what lies
# behind them, opacities of all ancestors included; what is not seen (closed, clipped, empty) is left out.
CONTRAST = """(() => {
  const parse = text => {
    const n = (text.match(/[\\d.]+/g) || []).map(Number);
    const unit = text.startsWith('color(') ? 255 : 1;
    return [n[0] * unit, n[1] * unit, n[2] * unit, n.length > 3 ? n[3] : 1];
  };
  const over = (top, below) => [0, 1, 2].map(k => top[k] * top[3] + below[k] * (1 - top[3])).concat(1);
  const light = c => {
    const [r, g, b] = c.map(v => v / 255).map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const known = new Map([[null, { ground: [255, 255, 255, 1], shade: 1 }]]);
  const behind = one => {
    if (!known.has(one)) {
      const below = behind(one.parentElement), style = getComputedStyle(one);
      const ground = over(parse(style.backgroundColor), below.ground);
      known.set(one, { ground, shade: below.shade * Number(style.opacity) });
    }
    return known.get(one);
  };
  const found = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node; (node = walk.nextNode());) {
    const one = node.parentElement, style = getComputedStyle(one);
    if (!node.data.trim() || one.closest('svg, script, style, noscript, template, .skip, .skip-to-content, .hidden')) continue;
    if (!one.checkVisibility({ checkOpacity: true, checkVisibilityCSS: true, contentVisibilityAuto: true })) continue;
    const box = one.getBoundingClientRect();
    if (box.width < 2 || box.height < 2 || one.matches(':disabled')) continue;
    const { ground, shade } = behind(one), ink = parse(style.color);
    const seen = over([ink[0], ink[1], ink[2], ink[3] * shade], ground);
    const [a, b] = [light(seen), light(ground)].sort((x, y) => y - x);
    const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    const ratio = (a + 0.05) / (b + 0.05);
    const what = `${one.tagName} .${one.className}: ${node.data.trim().slice(0, 40)}`;
    if (ratio < (large ? 3 : 4.5)) found.push(`${ratio.toFixed(2)} : 1, ${what}`);
  }
  return [...new Set(found)];
})()"""

# Everything that acts can have the focus and shows it, has a name, and nothing is put before its turn.
ACTS = """(within => {
  const found = [];
  const acting = 'a[href], button, input, select, textarea, summary, [tabindex], [onclick]';
  for (const one of document.querySelector(within).querySelectorAll(acting)) {
    if (!one.checkVisibility({ checkVisibilityCSS: true }) || one.type === 'hidden' || one.matches(':disabled')) continue;
    const what = `${one.tagName} .${one.className} ${one.textContent.trim().slice(0, 30)}`;
    if (one.tabIndex > 0) found.push(`before its turn: ${what}`);
    const by = (one.getAttribute('aria-labelledby') || '').split(' ').map(i => document.getElementById(i)?.textContent);
    const pictures = Array.from(one.querySelectorAll('img, svg'), i => i.alt || i.getAttribute('aria-label'));
    const own = [one.textContent, one.getAttribute('aria-label'), one.title, one.placeholder, one.value];
    const name = own.concat(Array.from(one.labels || [], l => l.textContent), pictures, by);
    if (!name.some(text => (text || '').trim())) found.push(`without a name: ${what}`);
    if (one.tabIndex < 0 && !one.matches('[onclick]')) continue;
    one.focus({ preventScroll: true, focusVisible: true });
    if (document.activeElement !== one) { found.push(`cannot be reached: ${what}`); continue; }
    const style = getComputedStyle(one);
    const around = getComputedStyle(one, '::after'), outlined = [style, around].some(s => s.outlineStyle !== 'none');
    if (!outlined && style.boxShadow === 'none') found.push(`focus is not seen: ${what}`);
  }
  document.activeElement.blur();
  return [...new Set(found)];
})"""


def faint(page: chromium.Browser) -> Any:
    """Return the texts of an open page whose contrast is too small [list of str]."""
    return page.evaluate(CONTRAST)


def unreachable(page: chromium.Browser, within: str = "body") -> Any:
    """Return what acts on an open page, in one part of it, and cannot be used by keyboard [list of str]."""
    return page.evaluate(f"{ACTS}({json.dumps(within)})")
