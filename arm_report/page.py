"""The page itself: skeleton, style, and the sentences that are set apart from the text."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1d2733; max-width: 66rem; margin: 2rem auto; padding: 0 1.2rem }
h1 { font-size: 1.5rem; margin-bottom: .2rem }
h2 { font-size: 1.15rem; margin-top: 2.2rem; border-bottom: 1px solid #d8dee6 }
table { border-collapse: collapse; margin: .6rem 0 } th { text-align: left; font-weight: 600; color: #51606f }
th, td { padding: .18rem .9rem .18rem 0; border-bottom: 1px solid #edf0f4; vertical-align: top }
td.n, th.n { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums } tr.weak td { color: #8b97a5 }
td.u { white-space: nowrap } img { max-width: 100% } small, .note { color: #6b7886 }
.verdict, .refuted { font-size: 1.1rem; padding: .7rem 1rem; background: #eef4fb; border-left: 4px solid #2f6fb0 }
.refuted { background: #fbeeee; border-left-color: #b03a2f }
.warning { background: #fdf3e3; border-left: 4px solid #d08a1c; padding: .35rem 1rem; margin: .35rem 0 }
summary { cursor: pointer; margin: .5rem 0; color: #2f6fb0 } code { background: #f3f5f8; padding: .1rem .35rem }
.wide { overflow-x: auto }
@media (max-width: 40rem) { .wide img { max-width: none; width: 52rem } }
@media print {
  details::details-content { content-visibility: visible }
  img, tr { break-inside: avoid } h2 { break-after: avoid }
}
"""


def page(title: str, body: Iterable[str]) -> str:
    """A whole HTML document. ``title`` is text and also the heading; ``body`` is HTML."""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head><body>\n"
        + "\n".join([f"<h1>{escape(title)}</h1>", *body])
        + "</body></html>\n"
    )


def verdict(sentence: str, *, refuted: bool = False) -> str:
    """The one sentence that a page is about; ``sentence`` is text."""
    return f"<p class={'refuted' if refuted else 'verdict'}>{escape(sentence)}</p>"


def warning(sentence: str) -> str:
    """What weakens the verdict; ``sentence`` is text."""
    return f"<p class=warning>{escape(sentence)}</p>"


def note(html: str) -> str:
    """How to read what follows; ``html`` is HTML."""
    return f"<p class=note>{html}</p>"
