"""The site is built without a network, loads nothing from another host, and is searched in a browser from a folder."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from arm_model.effects import CATALOGUE

pytest.importorskip("material")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
METHOD = "diagnosis-method.html"
"""A page with equations, as opposed to some effects."""
NO_NETWORK = """
import socket
def refuse(*args, **kwargs):
    raise RuntimeError(f"the build asked for a connection: {args[1:]}")
socket.socket.connect = socket.socket.connect_ex = socket.getaddrinfo = refuse
"""
LOADED = re.compile(r"<(?:script|link|img|iframe|source|video)\b[^>]*?\b(?:src|href)=[\"']?((?:https?:)?//[^\"'\s>]+)")


def _build(root: Path, out: Path, shadow: Path, *options: str) -> subprocess.CompletedProcess[str]:
    shadow.mkdir(exist_ok=True)
    (shadow / "sitecustomize.py").write_text(NO_NETWORK)
    return subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(out), *options],
        cwd=root,
        env=os.environ | {"PYTHONPATH": str(shadow), "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )


@pytest.fixture(scope="module")
def site(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site."""
    folder = tmp_path_factory.mktemp("site")
    built = _build(root, folder / "site", folder / "shadow")
    assert built.returncode == 0, built.stderr
    assert "WARNING" not in built.stderr, built.stderr
    return folder / "site"


def test_every_effect_has_a_page_with_its_neighbours(site: Path) -> None:
    for effect in CATALOGUE.values():
        page = (site / "effects" / f"{effect.name}.html").read_text()
        for other in effect.confused_with:
            assert f'href="{other}.html"' in page
        assert 'class="math"' in page or not re.search(r"[=^]", effect.equation)


def test_every_effect_has_a_picture_of_its_own(site: Path) -> None:
    pictures = {(site / "effects" / f"{name}.png").read_bytes() for name in CATALOGUE}
    assert len(pictures) == len(CATALOGUE)
    for name in CATALOGUE:
        assert f'src="{name}.png"' in (site / "effects" / f"{name}.html").read_text()


def test_nothing_is_loaded_from_another_host(site: Path) -> None:
    found = {
        f"{path.relative_to(site)}: {address}"
        for path in site.rglob("*.html")
        for address in LOADED.findall(path.read_text())
    }
    assert not found
    for path in [*site.rglob("*.css"), *site.rglob("*.js")]:
        text = path.read_text()
        assert not re.search(r"url\([\"']?(https?:)?//", text), path
        assert not re.search(r"https?://(unpkg|cdn|fonts|api)\b", text), path


def test_search_answers_from_a_folder(site: Path, browser: Any) -> None:
    page = browser.new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((site / "index.html").as_uri())
    page.locator("input.md-search__input").press_sequentially("stribeck velocity", delay=20)
    page.locator(".md-search-result__link").first.wait_for(timeout=60_000)
    assert "stribeck_friction.html" in str(page.locator(".md-search-result__link").first.get_attribute("href"))
    assert [url for url in asked if not url.startswith(("file:", "blob:", "data:"))] == []
    page.close()


def test_every_equation_is_typeset(site: Path, browser: Any) -> None:
    page = browser.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    effects = (f"effects/{name}.html" for name in CATALOGUE)
    for place in [METHOD, "effects/index.html", *effects]:
        page.goto((site / place).as_uri())
        formulas = page.locator(".math").count()
        assert page.locator(".math .katex").count() == formulas, place
        assert formulas or place != METHOD
    assert not errors
    page.close()


def test_a_broken_link_ends_the_build(root: Path, tmp_path: Path) -> None:
    docs = tmp_path / "docs"
    shutil.copytree(root / "docs", docs)
    with (docs / "terminal.md").open("a") as page:
        page.write("\n[gone](gone.md) and [no such place](model.md#no-such-place)\n")
    settings = (root / "mkdocs.yml").read_text().replace("docs_dir: docs", f"docs_dir: {docs}")
    settings = settings.replace("website/", f"{root}/website/").replace("paths: [.]", f"paths: [{root}]")
    (tmp_path / "mkdocs.yml").write_text(settings)
    built = _build(root, tmp_path / "out", tmp_path / "shadow", "-f", str(tmp_path / "mkdocs.yml"))
    assert built.returncode != 0
    assert "gone.md" in built.stderr and "no-such-place" in built.stderr
    assert "Aborted with 2 warnings" in built.stderr + built.stdout
