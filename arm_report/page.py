"""Pages from jinja2 templates: words are escaped, charts are drawn, and everything stands in one file."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from arm_io.parallel import in_parallel
from arm_report.chart import Chart
from arm_report.motion import Motion
from arm_report.numbers import typeset
from arm_report.plain import page_data, thinned
from arm_report.stills import stills

SCRIPTS = ("data.js", "panel.js", "chart.js", "arm.js", "report.js")
"""In the order in which they need each other; uPlot stands before them."""


@dataclass(frozen=True, kw_only=True)
class Report:
    """A page before it is one.

    title     and heading
    template  "PACKAGE/FILE": a file in the folder ``templates`` of a package, which extends "arm_report/page.html"
    content   what the template names; its strings are text and are escaped, unless they are ``Markup``
    joints    names of the arm's joints, which can be switched off and on; empty: there are none to choose from
    motion    of the arm, shown where a chart is pointed at
    """

    title: str
    template: str
    content: Mapping[str, Any]
    joints: Sequence[str] = ()
    motion: Motion | None = None

    def render(self) -> tuple[str, list[Chart]]:
        """The whole HTML document, and the charts in it."""
        charts: list[Chart] = []

        def collect(chart: Chart) -> Markup:
            charts.append(chart)
            return Markup()

        self._filled(collect, Markup())
        if not charts:
            return self._filled(collect, Markup()), charts
        # the number of points per chart depends on all charts
        drawn: list[Callable[[], Any]] = [
            lambda: page_data(charts, self.motion, list(self.joints)),
            lambda: stills(charts),
        ]
        (data, points), pictures = in_parallel(lambda draw: draw(), drawn)
        places = iter(range(len(charts)))

        def draw(chart: Chart) -> Markup:
            k = next(places)
            return Markup(_parts().module.chart(chart, k, thinned(chart, points), pictures[k]))

        return self._filled(draw, _scripts(data)), charts

    def _filled(self, draw: Callable[[Chart], Markup], scripts: Markup) -> str:
        template = environment().get_template(self.template)
        return template.render({"title": self.title, "draw": draw, "scripts": scripts, **self.content})

    def html(self) -> str:
        """The whole HTML document."""
        return self.render()[0]


@cache
def environment() -> Environment:
    """Escapes whatever is not ``Markup``, and refuses names that were not given."""
    made = Environment(
        loader=FunctionLoader(_source), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    made.filters["typeset"] = typeset
    made.globals |= {"style": Markup(_text("vendor/uplot.css") + _text("report.css")), "table": table}
    return made


def _source(name: str) -> str:
    package, _, file = name.partition("/")
    return (files(package) / "templates" / file).read_text(encoding="utf-8")


@cache
def _text(name: str) -> str:
    return (files("arm_report") / "static" / name).read_text(encoding="utf-8")


def _parts() -> Any:
    return environment().get_template("arm_report/parts.html")


def _scripts(data: str) -> Markup:
    """Data and scripts; text that a browser would take for the end of a script is escaped."""
    harmless = data.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
    module = _text("vendor/uplot.js").strip()
    library = re.sub(r"export\s*\{\s*(\w+) as default\s*\};?$", r"return \1;", module)
    scripts = "\n".join(map(_text, SCRIPTS))
    return Markup(
        f'<script type="application/json" id="data">{harmless}</script>\n'
        f'<script>"use strict";(() => {{\nconst uPlot = (() => {{\n{library}\n}})();\n{scripts}\n}})();</script>'
    )


def table(
    rows: Iterable[Sequence[Any]],
    head: Sequence[Any],
    numbers: Collection[int] = (),
    weak: Collection[int] = (),
    *,
    stacked: bool = False,
) -> Markup:
    """A table; cells are text or ``Markup``. The last cell of a row shorter than ``head`` spans the columns left.

    numbers  columns (from 0) that hold numbers, set flush right
    weak     rows (from 0) in grey
    stacked  on a narrow screen the cells of a row stand below each other, each with its head: for few rows of sentences
    """
    return Markup(_parts().module.table(list(rows), list(head), list(numbers), list(weak), stacked))


def warning(sentence: str) -> Markup:
    """A paragraph with a warning that weakens a verdict."""
    return Markup(_parts().module.warning(sentence))
