"""What pyproject.toml cannot say.

``config/`` is installed as ``armscope/config``, where ``armscope.shipped`` finds it.
"""

from pathlib import Path
from shutil import copy2

from setuptools import setup
from setuptools.command.build_py import build_py

SHIPPED = {".toml", ".json", ".xml", ".service", ".md"}


class BuildWithConfig(build_py):
    """Build of the packages, with the shipped files. An editable install reads ``config/`` of its checkout."""

    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            for source in Path("config").rglob("*"):
                if source.suffix in SHIPPED:
                    target = Path(self.build_lib, "armscope", source)
                    target.parent.mkdir(parents=True, exist_ok=True)
                    copy2(source, target)


setup(cmdclass={"build_py": BuildWithConfig})
