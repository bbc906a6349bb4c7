"""Pages of the site that are not in docs/: README.md, CONTRIBUTING.md, and the files of examples/own_arm."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OUTSIDE = {"index.md": "README.md", "contributing.md": "CONTRIBUTING.md"}
"""Page of the site -> file of the repository."""
OWN_ARM = "examples/own_arm"
NAMED = re.compile(r"`?\b(?<![(/\]])docs/((?:decisions/)?[\w-]+)\.md`?(?![\w)#])")


def outside(page: str) -> str:
    """Markdown of a page that is a file outside docs/, its links as they must be from there."""
    text = (ROOT / OUTSIDE[page]).read_text(encoding="utf-8")
    alone = "---\nhide: [navigation]\n---\n\n" if page == "index.md" else ""
    text = text.replace("](docs/decisions/)", "](decisions/README.md)").replace(
        "](CONTRIBUTING.md)", "](contributing.md)"
    )
    return alone + text.replace("](docs/", "](")


def own_arm() -> tuple[str, dict[str, str]]:
    """The page that lists the files of the first hour, and those files: path in the site -> path in the repository."""
    files = {f"{OWN_ARM}/{path.name}": str(path) for path in sorted((ROOT / OWN_ARM).iterdir()) if path.is_file()}
    listed = "".join(f"* [{Path(name).name}]({Path(name).name})\n" for name in files)
    return (
        "# The files of the first hour\n\nAn arm and two logs of its controller on two days, for "
        f"[the first hour with an arm of your own](../../first-hour-own-arm.md).\n\n{listed}",
        files,
    )


def decisions() -> list[str]:
    """The decisions' pages in order, their index first."""
    folder = ROOT / "docs" / "decisions"
    numbered = sorted(path.name for path in folder.glob("[0-9]*.md"))
    return [f"decisions/{name}" for name in ("README.md", *numbered)]


def linked(text: str, page: str) -> str:
    """Markdown with a link wherever prose names another document as docs/NAME.md; ``page``: where it stands."""
    up = "../" * page.count("/")
    lines = []
    fenced = False
    for line in text.splitlines():
        fenced ^= line.startswith("```")
        if not fenced and not line.startswith("    "):
            line = NAMED.sub(lambda match: f"[{match[1].rpartition('/')[2]}]({up}{match[1]}.md)", line)
        lines.append(line)
    text = "\n".join(lines).replace(f"](../{OWN_ARM})", f"]({OWN_ARM}/README.md)")
    return text.replace("](../CONTRIBUTING.md)", "](contributing.md)") + "\n"
