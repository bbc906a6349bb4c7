"""A page per effect, from its definition in the catalogue (``arm_model.effects``), and the page that lists them."""

from __future__ import annotations

from typing import Any

from arm_model.effects import CATALOGUE, Effect, Parameter, Place
from website.equations import typeset

FOLDER = "effects"
PLACES = {
    Place.MECHANICS: "Mechanics: torques and masses",
    Place.TRANSMISSION: "Transmission: between motor and link",
    Place.SENSING: "Sensing: what instruments say",
    Place.TIMING: "Timing: when they say it",
    Place.GEOMETRY: "Geometry: where the links are",
}


def title(name: str) -> str:
    """An effect's name as words."""
    return name.replace("_", " ").capitalize()


def page_of(name: str) -> str:
    """Path of an effect's page in the site."""
    return f"{FOLDER}/{name}.md"


def navigation() -> list[Any]:
    """Entries of the navigation: the list of effects, then their pages by place."""
    by_place = [
        {str(place).capitalize(): [{title(e.name): page_of(e.name)} for e in CATALOGUE.values() if e.place is place]}
        for place in PLACES
    ]
    return [f"{FOLDER}/index.md", *by_place]


def listing() -> str:
    """The page that lists all effects, by where they sit in the chain from motor to file."""
    parts = [
        "# Effects: what a simulation can get wrong\n\n"
        f"The catalogue has {len(CATALOGUE)} effects. Each is defined once, in `arm_model/effects/`; simulation, "
        "identification, diagnosis and these pages read that definition ([adding an effect](../adding-an-effect.md)). "
        "[Diagnosis](../diagnosis.md) tries all of them at every joint.\n"
    ]
    for place, heading in PLACES.items():
        rows = [
            f"| {_link(effect.name)} | {_cell(typeset(effect.equation))} | {_cell(effect.shows)} |"
            for effect in CATALOGUE.values()
            if effect.place is place
        ]
        parts.append(
            f"\n\n## {heading}\n\n| effect | equation | what a person sees |\n|---|---|---|\n" + "\n".join(rows)
        )
    return "".join(parts) + "\n"


def page(effect: Effect, picture: str | None = None) -> str:
    """Markdown of an effect's page; ``picture``: caption of its picture, NAME.png beside it."""
    parts = [
        f"# {title(effect.name)}\n",
        f'<p class="equation">{typeset(effect.equation)}</p>\n',
        f"{_sentence(effect.shows)}\n",
        _facts(effect),
        _picture(effect, picture),
        "## Parameters\n",
        _parameters(effect),
        _neighbours(effect),
        _use(effect),
    ]
    return "\n".join(part for part in parts if part)


def _picture(effect: Effect, caption: str | None) -> str:
    if caption is None:
        return ""
    return f"![{caption}]({effect.name}.png){{ .signature }}\n\n*{caption}*\n"


def _facts(effect: Effect) -> str:
    whose = "one joint" if effect.per_joint else "the arm as a whole"
    observed = ", ".join(f"{instrument} (against {seen.against})" for instrument, seen in effect.observed_by.items())
    return (
        f"`{effect.name}` belongs to {whose} ({effect.place}). It shows when a joint has {effect.excited_by}. "
        f"Observed by: {observed}.\n"
    )


def _parameters(effect: Effect) -> str:
    head = "| parameter | unit | typical size | meaning |\n|---|---|---|---|\n"
    return head + "\n".join(_row(parameter) for parameter in effect.parameters) + "\n"


def _row(parameter: Parameter) -> str:
    low, high = parameter.typical
    notes = [
        *(["may be negative"] if parameter.signed and low >= 0 else []),
        *(["an integer"] if parameter.whole else []),
        *(["follows from the joint where it is not given"] if parameter.derived else []),
    ]
    meaning = _cell(parameter.meaning) + (f" ({', '.join(notes)})" if notes else "")
    unit = "" if parameter.unit == "1" else parameter.unit
    return f"| `{parameter.name}` | {unit} | {low:g} to {high:g} | {meaning} |"


def _neighbours(effect: Effect) -> str:
    """How it is distinguished from every effect that either of the two definitions names."""
    others = {other.name: other.confused_with.get(effect.name) for other in CATALOGUE.values()}
    rows = dict(effect.confused_with) | {
        name: how for name, how in others.items() if how and name not in effect.confused_with
    }
    if not rows:
        return "## How it is distinguished\n\nNo other effect of the catalogue looks like it.\n" + _same(effect)
    table = "\n".join(f"| {_link(name)} | {_cell(how)} |" for name, how in rows.items())
    head = "## How it is distinguished\n\n| may be taken for | what distinguishes them |\n|---|---|\n"
    return f"{head}{table}\n\n{_same(effect)}"


def _same(effect: Effect) -> str:
    """Sentences about effects that it contains, or is the same as."""
    sentences = [
        (
            effect.aliases,
            "In currents it is indistinguishable from {}: an ambiguity group.",
        ),
        (effect.special_cases, "It contains {} as a special case; the simpler effect is named where it suffices."),
        (effect.near_cases, "While poses or times differ little, {} is nearly the same."),
        *(
            (seen.aliases, f"To the {instrument} it is the same as {{}}.")
            for instrument, seen in effect.observed_by.items()
        ),
    ]
    return "\n".join(sentence.format(" and ".join(map(_link, names))) + "\n" for names, sentence in sentences if names)


def _use(effect: Effect) -> str:
    joint = "joint = 1\n" if effect.per_joint else ""
    needs = "It needs the `cylinder` of its joint. " if effect.cylinder else ""
    values = ", ".join(f"{p.name} = {example_text(p)}" for p in effect.parameters if p.linear or not p.derived)
    return (
        "## In a model file\n\n"
        f'```toml\n[[effect]]\nname = "{effect.name}"\n{joint}parameters = {{ {values} }}\n```\n\n'
        f"{needs}The simulation then has it ([model files](../models.md)); "
        "[`armscope diagnose`](../diagnosis.md) finds it.\n"
    )


def example_text(parameter: Parameter) -> str:
    """A typical value, as a model file has it."""
    low, high = parameter.typical
    value = (low * high) ** 0.5 if low > 0 else high / 2
    return f"{round(value)}" if parameter.whole else f"{value:.2g}"


def _link(name: str) -> str:
    return f"[{title(name)}]({name}.md)"


def _cell(text: str) -> str:
    return text.replace("|", "&#124;")


def _sentence(text: str) -> str:
    text = text[:1].upper() + text[1:]
    return text if text.endswith(".") else f"{text}."
