"""Messages and documents use the field's terms (CONTRIBUTING.md, glossary), no idioms or metaphors."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

from tests.house.sources import syntax
from tests.house.test_arrows import MAY_IMPORT

ROOT = Path(__file__).parents[2]
PACKAGES = sorted(MAY_IMPORT)
INSTEAD = {
    r"wants?( to be)?\b(?! to (know|use|read))": "must be, needs",
    r"(is|are) wanted\b": "must be, is required",
    r"told from\b": "distinguished from",
    r"seen through\b": "residual under",
    r"as good as (nothing|invisible)": "negligible",
    r"nobody\b": "no client, no subscriber",
    r"what swings\b": "transmission resonance",
    r"strangers\b": "out-of-catalogue effects",
    r"loud(er|ness)?\b": "residual-to-noise ratio",
    r"twins\b": "aliased effects",
    r"weeded\b": "eliminated",
    r"fore(tell|tells|told)\b": "predict",
    r"(encoders|velocities|axis|run|value|names?|parameters?|recordings?|cycles|errors?) a joint\b": "per joint",
    r"way is free\b": "the workspace is clear",
}
"""Pattern of an old word -> what to write."""
OLD = re.compile("|".join(rf"\b{pattern}" for pattern in INSTEAD), re.IGNORECASE)
NOWHERE = re.compile(
    r"\b(told from|(is|are|be) wanted|strangers|fore(tell|tells|told)|as good as (nothing|invisible)|what swings|weeded"
    r"|to and fro"
    r"|(one|row|two|sentence|number|column|block|times|counts?) a (joint|second|turn|row|run|cause|motion|step))\b",
    re.IGNORECASE,
)
"""Idioms that docstrings and comments do without as well."""
SHOWN = {
    "InputError",
    "DeviceFault",
    "print",
    "Option",
    "Argument",
    "warn",
    "note",
    "verdict",
    "warning",
    "say",
    "_say",
    "progress",
}
"""Functions whose string arguments a user reads."""


def literals(tree: ast.AST) -> list[tuple[int, str]]:
    """Line and text of every string that a user reads.

    Arguments of the functions above, yielded sentences, constants of reports.
    """
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name not in SHOWN:
                continue
            parts = [*node.args, *(keyword.value for keyword in node.keywords)]
        elif isinstance(node, ast.Yield) and node.value is not None:
            parts = [node.value]
        else:
            continue
        inside = [leaf for part in parts for leaf in ast.walk(part)]
        found += [
            (leaf.lineno, leaf.value)
            for leaf in inside
            if isinstance(leaf, ast.Constant) and isinstance(leaf.value, str)
        ]
    return found


def prose(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of every comment and every string in triple quotes."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT or (token.type == tokenize.STRING and token.string.endswith('"""')):
            yield token.start[0], token.string


def torn(docstring: str) -> bool:
    """Whether a summary line is cut: a bracket stays open, or the next paragraph goes on with its sentence."""
    summary, _, rest = docstring.partition("\n")
    return summary.count("(") > summary.count(")") or bool(re.match(r"(And|Or|Nor|Than) ", rest.lstrip()))


def test_messages() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: {word.group()!r} in {text!r}"
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for line, text in literals(syntax(path))
        if (word := OLD.search(text))
    ]
    assert not wrong, "\n".join(wrong)


def test_documents() -> None:
    documents = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
    wrong = [
        f"{path.relative_to(ROOT)}:{number}: {word.group()!r}"
        for path in documents
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if (word := OLD.search(re.sub(r"`[^`]*`|^    .*", "", line)))
    ]
    assert not wrong, "\n".join(wrong)


def test_an_old_word_is_found() -> None:
    tree = ast.parse('raise InputError(path, f"{name} wants a number")\nprint("two encoders a joint")\nx = "nobody"')
    assert [bool(OLD.search(text)) for _, text in literals(tree) if " " in text] == [True, True]


def test_docstrings_and_comments() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: {word.group()!r}"
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for line, text in prose(path.read_text(encoding="utf-8"))
        if (word := NOWHERE.search(text))
    ]
    assert not wrong, "\n".join(wrong)


def test_docstrings_are_whole() -> None:
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    wrong = [
        f"{path.relative_to(ROOT)}: {docstring.splitlines()[0]!r}"
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
        for node in ast.walk(syntax(path))
        if isinstance(node, documented) and (docstring := ast.get_docstring(node)) and torn(docstring)
    ]
    assert not wrong, "\n".join(wrong)


def test_a_torn_docstring_and_an_old_idiom_are_found() -> None:
    assert torn("Blocks (the leading axis.\n\nOthers are shared).") and torn("The arm.\n\nAnd its load.")
    assert not torn("Blocks (the leading axis).\n\nAndroid is whole.")
    texts = list(prose('x = "two a joint"\n# one a joint\ny = """It is told from nothing."""\n'))
    assert [(line, bool(NOWHERE.search(text))) for line, text in texts] == [(2, True), (3, True)]
