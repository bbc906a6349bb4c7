"""The documents as a site that works from a folder: ``make site``.

mkdocs.yml has the settings; ``hooks`` adds the pages that are generated: home (README.md), one page per effect of the
catalogue, the Python interface from docstrings. Nothing is loaded from another host, neither by the build nor by the
site.
"""
