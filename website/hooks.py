"""Events of MkDocs: generated pages, links by name, and no address of another host in what is built."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from arm_model.effects import CATALOGUE
from website import effects, home, pictures, reference

ASSETS = Path(__file__).resolve().parent / "assets"


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Fills the navigation of effects and of decisions, which mkdocs.yml leaves empty."""
    assert config.nav is not None
    for entry in config.nav:
        for heading, pages in entry.items():
            if heading == "Effects":
                pages += effects.navigation()
            for page in pages if isinstance(pages, list) else ():
                if isinstance(page, dict) and "Decisions" in page:
                    page["Decisions"] = home.decisions()
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds scripts and styles, and all pages that no file of docs/ holds."""
    for path in sorted(ASSETS.rglob("*")):
        if path.is_file():
            name = f"assets/{path.relative_to(ASSETS).as_posix()}"
            files.append(File.generated(config, name, abs_src_path=str(path)))
    for page in home.OUTSIDE:
        files.append(File.generated(config, page, content=home.outside(page)))
    listing, downloads = home.own_arm()
    files.append(File.generated(config, f"{home.OWN_ARM}/README.md", content=listing))
    for name, path_name in downloads.items():
        files.append(File.generated(config, name, abs_src_path=path_name))
    files.append(File.generated(config, f"{effects.FOLDER}/index.md", content=effects.listing()))
    for effect in CATALOGUE.values():
        shown = pictures.picture(effect)
        files.append(File.generated(config, effects.page_of(effect.name), content=effects.page(effect, shown.caption)))
        files.append(File.generated(config, f"{effects.FOLDER}/{effect.name}.png", content=shown.png))
    for name, text in reference.pages().items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Links wherever prose names another document."""
    return home.linked(markdown, page.file.src_uri)


def on_post_build(config: MkDocsConfig) -> None:
    """Takes the addresses of other hosts out of Material's scripts: fallbacks of old browsers, and a diagram drawer."""
    site = Path(config.site_dir)
    scripts = site / "assets" / "javascripts"
    for path in scripts.rglob("*.js"):
        text = path.read_text(encoding="utf-8")
        path.write_text(re.sub(r"https://(unpkg\.com|api\.github\.com)/", "about:blank#", text), encoding="utf-8")
    for path in (*site.rglob("*.map"), *site.rglob("sitemap.xml*")):
        path.unlink()
