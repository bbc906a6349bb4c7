"""What a shell completes: commands, the options of each, and names of files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

Options = Mapping[str, Mapping[str, str]]
"""Command -> option -> one line of help."""


def options_of(command: Any) -> dict[str, str]:
    """The options of a click command, with their help."""
    return {
        option: " ".join((getattr(parameter, "help", None) or "").split())
        for parameter in command.params
        for option in parameter.opts
        if option.startswith("--")
    } | {"--help": "show the options and examples"}


def bash(commands: Mapping[str, str], options: Options) -> str:
    """A completion for bash."""
    cases = "\n".join(f'        {name}) words="{" ".join(sorted(options[name]))}" ;;' for name in commands)
    return f"""# completion of armscope for bash: source it, or keep it where bash-completion looks
_armscope() {{
    local current="${{COMP_WORDS[COMP_CWORD]}}" words=""
    if [ "$COMP_CWORD" -eq 1 ]; then
        COMPREPLY=($(compgen -W "{" ".join(commands)} --help --version" -- "$current"))
        return
    fi
    case "${{COMP_WORDS[1]}}" in
{cases}
    esac
    case "$current" in
        -*) COMPREPLY=($(compgen -W "$words" -- "$current")) ;;
        *) COMPREPLY=($(compgen -f -- "$current")) ;;
    esac
}}
complete -o filenames -F _armscope armscope
"""


def zsh(commands: Mapping[str, str], options: Options) -> str:
    """A completion for zsh: that of bash."""
    return "autoload -U +X compinit && compinit\nautoload -U +X bashcompinit && bashcompinit\n" + bash(
        commands, options
    )


def fish(commands: Mapping[str, str], options: Options) -> str:
    """A completion for fish, with descriptions."""
    lines = [
        "# completion of armscope for fish: keep it in ~/.config/fish/completions/armscope.fish",
        # the second word only: 'plot' is also an action of 'archive'
        "function __armscope_command",
        "    set -l words (commandline -opc)",
        '    test "$words[2]" = "$argv[1]"',
        "end",
    ]
    for name, text in commands.items():
        lines.append(f"complete -c armscope -n '__armscope_command \"\"' -f -a {name} -d {_quoted(text)}")
        lines += [
            f"complete -c armscope -n '__armscope_command {name}' -l {option[2:]} -d {_quoted(said)}"
            for option, said in options[name].items()
        ]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


SHELLS: dict[str, Callable[[Mapping[str, str], Options], str]] = {"bash": bash, "zsh": zsh, "fish": fish}
