# SPDX-License-Identifier: BSD-3-Clause
"""Zoom and pan of the report's plots: a script within the page, and a policy that lets no other one run.

A plot is an SVG; what is shown of it is its ``viewBox``, four numbers. The wheel zooms about the pointer once a plot
was clicked (or with Ctrl held, so that a page can still be scrolled), dragging pans, a double click shows all of it;
plus, minus, arrows and 0 do the same on the keyboard. Without a script the page is whole, but for this.
"""

from __future__ import annotations

import base64
import hashlib

HINT = (
    "Plots can be zoomed: click one, then turn the wheel and drag; a double click shows all of it again. On the"
    " keyboard: Tab to a plot, then plus, minus, arrows, and 0 for all of it."
)

SCRIPT = """
'use strict';
for (const svg of document.querySelectorAll('figure svg')) {
  const all = svg.viewBox.baseVal, home = [all.x, all.y, all.width, all.height];
  let shown = home.slice(), from = null;
  const show = function (next) {
    const width = Math.min(Math.max(next[2], home[2] / 50), home[2]), height = width * home[3] / home[2];
    const x = Math.min(Math.max(next[0], home[0]), home[0] + home[2] - width);
    const y = Math.min(Math.max(next[1], home[1]), home[1] + home[3] - height);
    shown = [x, y, width, height];
    svg.setAttribute('viewBox', shown.join(' '));
    svg.classList.toggle('zoomed', width < home[2]);
  };
  const zoom = function (factor, u, v) {
    const width = Math.min(shown[2] * factor, home[2]), height = width * home[3] / home[2];
    show([shown[0] + u * (shown[2] - width), shown[1] + v * (shown[3] - height), width, height]);
  };
  const pan = function (u, v) {
    show([shown[0] + u * shown[2], shown[1] + v * shown[3], shown[2], shown[3]]);
  };
  svg.setAttribute('tabindex', '0');
  svg.addEventListener('wheel', function (event) {
    if (document.activeElement !== svg && !event.ctrlKey) { return; }
    event.preventDefault();
    const box = svg.getBoundingClientRect();
    zoom(event.deltaY < 0 ? 0.8 : 1.25, (event.clientX - box.left) / box.width,
      (event.clientY - box.top) / box.height);
  }, { passive: false });
  svg.addEventListener('pointerdown', function (event) {
    svg.focus({ preventScroll: true });
    if (shown[2] < home[2]) {
      from = [event.clientX, event.clientY];
      svg.setPointerCapture(event.pointerId);
    }
  });
  svg.addEventListener('pointermove', function (event) {
    if (from === null) { return; }
    const box = svg.getBoundingClientRect();
    pan((from[0] - event.clientX) / box.width, (from[1] - event.clientY) / box.height);
    from = [event.clientX, event.clientY];
  });
  for (const name of ['pointerup', 'pointercancel']) {
    svg.addEventListener(name, function () { from = null; });
  }
  svg.addEventListener('dblclick', function () { show(home); });
  svg.addEventListener('keydown', function (event) {
    const keys = {
      '+': function () { zoom(0.8, 0.5, 0.5); }, '=': function () { zoom(0.8, 0.5, 0.5); },
      '-': function () { zoom(1.25, 0.5, 0.5); }, '0': function () { show(home); },
      'ArrowLeft': function () { pan(-0.1, 0); }, 'ArrowRight': function () { pan(0.1, 0); },
      'ArrowUp': function () { pan(0, -0.1); }, 'ArrowDown': function () { pan(0, 0.1); }
    };
    if (Object.prototype.hasOwnProperty.call(keys, event.key) && !event.ctrlKey && !event.metaKey) {
      event.preventDefault();
      keys[event.key]();
    }
  });
}
"""
"""Touches nothing but the plots of the page it stands in."""


def policy() -> str:
    """Returns the page's Content-Security-Policy: this script by its hash, styles and pictures of the page itself."""
    digest = base64.b64encode(hashlib.sha256(SCRIPT.encode()).digest()).decode()
    rules = f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; img-src data:"
    return f'<meta http-equiv="Content-Security-Policy" content="{rules}">'
