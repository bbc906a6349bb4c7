"""Pages of the Python interface: every name that ``import armscope`` offers, from its docstring (mkdocstrings)."""

from __future__ import annotations

import inspect

import armscope

FOLDER = "reference"
LINES = {
    "functions": "Functions",
    "results": "Results and inputs",
    "errors": "Errors",
}


def pages() -> dict[str, str]:
    """Path -> Markdown, the overview first."""
    names = [name for name in armscope.__all__ if not name.startswith("_") and name != "effects"]
    found = {name: getattr(armscope, name) for name in names}
    rooms: dict[str, list[str]] = {room: [] for room in LINES}
    for name, value in found.items():
        failing = inspect.isclass(value) and issubclass(value, BaseException)
        rooms["errors" if failing else "results" if inspect.isclass(value) else "functions"].append(name)
    overview = (
        "# Reference of the Python interface\n\n"
        "What `import armscope` offers, from the docstrings of the code. [Python interface](../api.md) has examples of "
        "each; `armscope.effects` is the [catalogue of effects](../effects/index.md).\n"
    )
    for room, members in rooms.items():
        rows = [f"| [`{name}`]({room}.md#armscope.{name}) | {_summary(found[name])} |" for name in members]
        overview += f"\n## {LINES[room]}\n\n| name | |\n|---|---|\n" + "\n".join(rows) + "\n"
    made = {f"{FOLDER}/index.md": overview}
    for room, members in rooms.items():
        blocks = "\n".join(f"::: armscope.{name}\n" for name in members)
        made[f"{FOLDER}/{room}.md"] = f"# {LINES[room]}\n\n{blocks}"
    return made


def _summary(value: object) -> str:
    return (inspect.getdoc(value) or "").partition("\n")[0].replace("|", "&#124;")
