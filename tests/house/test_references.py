"""What docstrings and documents refer to is there."""

import ast
import io
import re
import tokenize
from functools import cache
from pathlib import Path

from tests.house.sources import syntax
from tests.house.test_arrows import MAY_IMPORT

ROOT = Path(__file__).parents[2]
SOURCES = [*sorted(MAY_IMPORT), "tests", "benchmarks", "examples", "website"]
DATA = ("config", "diagnosis", "docs", "tests", "website")
OF_OTHERS = {"ljm_constants", "OUT"}
"""Of a maker's own library, and what a sentence stands for."""
EXAMPLES = {"arm_model/effects/lubrication.py", "drivers/NAME/protocol.py"}
"""Files that a reader is to write."""


@cache
def sources() -> tuple[Path, ...]:
    return tuple(path for folder in SOURCES for path in sorted((ROOT / folder).rglob("*.py")))


@cache
def words() -> frozenset[str]:
    """Every identifier, every word of a string that is no docstring, every module, and every word of the data files."""
    found = set()
    for path in sources():
        found.update(path.relative_to(ROOT).with_suffix("").parts)
        for token in tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline):
            if token.type == tokenize.NAME:
                found.add(token.string)
            elif token.type == tokenize.STRING and not token.string.endswith('"""'):
                found.update(re.findall(r"\w+", token.string))
    for folder in DATA:
        for path in (ROOT / folder).rglob("*"):
            if path.suffix in {".toml", ".json"}:
                found.update(re.findall(r"\w+", path.read_text(encoding="utf-8", errors="ignore")))
    return frozenset(found)


def missing(text: str) -> list[str]:
    """Names in double backticks of which a part is nowhere; a number behind a name (``stamp1``) counts it."""
    found = []
    for name in re.findall(r"``([A-Za-z_][\w.]*)(?:\([^`]*\))?``", text):
        parts = {part for part in name.split(".") if part}
        if not all(part in words() or part.rstrip("0123456789") in words() for part in parts) and not parts & OF_OTHERS:
            found.append(name)
    return found


PLACEHOLDER = "X"
"""Of a device's name, in a dotted name."""


@cache
def defined(path: Path) -> frozenset[str]:
    """What a module defines or imports at any depth: functions, classes, variables, fields."""
    found = set()
    for node in ast.walk(syntax(path)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
        elif isinstance(node, ast.alias):
            found.add(node.asname or node.name.rpartition(".")[2])
    return frozenset(found)


def leads_somewhere(name: str) -> bool:
    """Whether a dotted name that begins with a package is that of a module, or of what the module has.

    Of what a face offers, its own names (``Chain.to_json``) are elsewhere and not looked for.
    """
    place, parts = ROOT, name.split(".")
    while parts and (place / parts[0]).is_dir():
        place = place / parts.pop(0)
    module = place / f"{parts.pop(0)}.py" if parts and (place / f"{parts[0]}.py").is_file() else place / "__init__.py"
    own = parts[:1] if module.stem == "__init__" else parts
    found = module.is_file() and all(part in defined(module) for part in own)
    return not parts or PLACEHOLDER in parts or found


DESCRIBED = re.compile(r"\n\n((?:[a-z_]\w*(?:, | and )?)+)(?: \([^)\n]*\))?(?: [\w/]+)?: ")
"""Names at the beginning of a paragraph that say what parameters are: ``left, right (n,): residuals of both``."""


def unknown_parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Names that a docstring describes as parameters, and that are neither these nor local names."""
    own = {node.arg for node in ast.walk(function) if isinstance(node, ast.arg)}
    own |= {node.id for node in ast.walk(function) if isinstance(node, ast.Name)}
    described = DESCRIBED.findall(ast.get_docstring(function) or "")
    return [name for names in described for name in re.split(", | and ", names) if name and name not in own]


def test_parameters_in_docstrings() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}: {function.name}: {name}"
        for path in sources()
        for function in ast.walk(syntax(path))
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for name in unknown_parameters(function)
    ]
    assert not wrong, "\n".join(wrong)


def test_a_parameter_that_is_not_there_is_found() -> None:
    source = 'def f(left):\n    """Both.\n\n    left, right (n,): residuals; up: m.\n\n    None: at once.\n    """'
    (function,) = ast.parse(source).body
    assert isinstance(function, ast.FunctionDef) and unknown_parameters(function) == ["right"]


def test_names_in_docstrings() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}: ``{name}``"
        for path in sources()
        if path.relative_to(ROOT).parts[0] != "tests"
        for name in missing(path.read_text(encoding="utf-8"))
    ]
    assert not wrong, "\n".join(wrong)


def test_whole_names_in_docstrings() -> None:
    """A function that has moved is not where ``missing`` looks, which asks for its name alone."""
    wrong = [
        f"{path.relative_to(ROOT)}: ``{name}``"
        for path in sources()
        for name in re.findall(r"``([A-Za-z_][\w.]*)(?:\([^`]*\))?``", path.read_text(encoding="utf-8"))
        if name.partition(".")[0] in SOURCES and not leads_somewhere(name)
    ]
    assert not wrong, "\n".join(wrong)


def test_a_name_that_is_elsewhere_is_found() -> None:
    assert leads_somewhere("tests.house.test_references.missing") and leads_somewhere("tests.house")
    assert not leads_somewhere("tests.house.sources.missing")


def test_files_in_documents() -> None:
    there = {path.relative_to(ROOT).as_posix() for path in sources()}
    wrong = [
        f"{document.relative_to(ROOT)}: {name}"
        for document in [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
        for name in re.findall(r"`([\w/]+\.py)", document.read_text(encoding="utf-8"))
        if name not in EXAMPLES and not any(f"/{path}".endswith(f"/{name}") for path in there)
    ]
    assert not wrong, "\n".join(wrong)


def test_a_name_that_is_nowhere_is_found() -> None:
    nowhere = "_".join(["nowhere", "at", "all"])
    assert missing(f"As ``words`` of ``words.{nowhere}``, ``sources()``.") == [f"words.{nowhere}"]
