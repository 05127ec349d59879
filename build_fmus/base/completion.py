"""Shell completion of command lines, from the declaration of the options.

Makes the completion script of each shell, and the completions of what is typed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from build_fmus.base.terminal import list_choices

SCRIPTS = {
    "bash": (
        """_cosim() {
    local IFS=$'\\n'
    COMPREPLY=($("${COMP_WORDS[0]}" complete -- "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null))
}
complete -o bashdefault -o default -F _cosim cosim suspension-fmus
"""
    ),
    "zsh": (
        """#compdef cosim suspension-fmus
_cosim() {
    local -a found
    found=("${(@f)$("${words[1]}" complete -- "${(@)words[2,$CURRENT]}" 2>/dev/null)}")
    if [[ -n $found ]]; then compadd -- $found; else _files; fi
}
compdef _cosim cosim suspension-fmus
"""
    ),
    "fish": (
        """function __cosim
    set -l typed (commandline -opc)
    $typed[1] complete -- $typed[2..-1] (commandline -ct | string collect --allow-empty) 2>/dev/null
end
complete -c cosim -a '(__cosim)'
complete -c suspension-fmus -a '(__cosim)'
"""
    ),
}
"""By shell. Where nothing fits, each offers files."""


def fitting(command: Any, words: Sequence[str]) -> list[str]:
    """Completions of the last of `words`: commands, options or the values of an option.

    Empty where the word may be a file.

    Args:
        command: of click, with all below it.
        words: as typed after the program's name; the last one is not complete, and may be empty.
    """
    *before, last = words or [""]
    value_of: Any = None  # the option that the next word is a value of
    for word in before:
        if value_of is not None:
            value_of = None
        elif word.startswith("-"):
            value_of = next((o for o in command.params if word in o.opts and not _is_flag(o)), None)
        elif hasattr(command, "get_command"):
            command = command.get_command(None, word)
            if command is None:
                return []
    if value_of is not None:
        list_choices(command)
        found = [name for name in (value_of.metavar or "").split("|") if not name.startswith("FILE")]
        found = found if len(found) > 1 else []
    elif last.startswith("-"):
        options = [o for o in command.params if getattr(o, "param_type_name", "") == "option"]
        found = [name for o in options for name in (*o.opts, *o.secondary_opts)] + ["--help"]
    else:
        found = command.list_commands(None) if hasattr(command, "list_commands") else []
    return [name for name in dict.fromkeys(found) if name.startswith(last)]


def _is_flag(option: Any) -> bool:
    return bool(getattr(option, "is_flag", False) or getattr(option, "count", False))
