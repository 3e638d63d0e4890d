"""Completion for bash, zsh and fish, as scripts that need neither modlens nor Python to run."""

from __future__ import annotations

from collections.abc import Iterator

from release.options import Command, Option

__all__ = ["bash", "fish", "zsh"]

GLOBAL = ("--help", "--version", "--no-pager", "help", "version")


def bash(commands: list[Command]) -> str:
    """The script for bash: `share/bash-completion/completions/modlens`."""
    names = " ".join([*(one.name for one in commands), *GLOBAL])
    values = [line for one in commands for line in _bash_values(one)]
    words = [line for one in commands for line in _bash_words(one)]
    return "\n".join(
        [
            "# Completion of modlens for bash; made of its parsers.",
            "_modlens() {",
            "    local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD-1]}",
            "    local command=${COMP_WORDS[1]} flags= words= files=yes",
            "    COMPREPLY=()",
            "    if ((COMP_CWORD == 1)); then",
            f'        mapfile -t COMPREPLY < <(compgen -W "{names}" -- "$current"',
            '            compgen -f -- "$current")',
            "        return",
            "    fi",
            '    case "$command $previous" in',
            *values,
            "    esac",
            '    case "$command" in',
            *words,
            "    esac",
            "    if [[ $current == -* ]]; then",
            '        mapfile -t COMPREPLY < <(compgen -W "$flags" -- "$current")',
            "    else",
            '        mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")',
            "        if [[ $files ]]; then",
            '            mapfile -t -O "${#COMPREPLY[@]}" COMPREPLY < <(compgen -f -- "$current")',
            "        fi",
            "    fi",
            "}",
            "complete -o filenames -F _modlens modlens",
            "",
        ]
    )


def _bash_values(command: Command) -> Iterator[str]:
    """What follows an option: its choices, or files; nothing can be said of other values."""
    for one in command.options:
        if not one.flags or not one.value:
            continue
        places = "|".join(f'"{command.name} {flag}"' for flag in one.flags)
        if one.choices:
            found = f'compgen -W "{" ".join(one.choices)}" -- "$current"'
        elif one.takes_file:
            found = 'compgen -f -- "$current"'
        else:
            yield f"        {places}) return ;;"
            continue
        yield f"        {places}) mapfile -t COMPREPLY < <({found}); return ;;"


def _bash_words(command: Command) -> Iterator[str]:
    files = "" if command.takes_files else " files="
    words = f' words="{" ".join(command.words)}"' if command.words else ""
    yield f'        {command.name}) flags="{" ".join(command.flags)}"{words}{files} ;;'


def zsh(commands: list[Command]) -> str:
    """The script for zsh: `share/zsh/site-functions/_modlens`."""
    named = [f"        '{one.name}:{_zsh(one.summary)}'" for one in commands]
    cases = [line for one in commands for line in _zsh_case(one)]
    return "\n".join(
        [
            "#compdef modlens",
            "# Completion of modlens for zsh; made of its parsers.",
            "_modlens() {",
            "    local -a commands",
            "    commands=(",
            *named,
            "    )",
            "    if ((CURRENT == 2)); then",
            "        _describe command commands",
            "        _files",
            "        return",
            "    fi",
            "    local command=$words[2]",
            "    shift words",
            "    ((CURRENT--))",
            "    case $command in",
            *cases,
            "    esac",
            "}",
            '_modlens "$@"',
            "",
        ]
    )


def _zsh_case(command: Command) -> Iterator[str]:
    yield f"        {command.name})"
    yield "            _arguments \\"
    for one in command.options:
        for flag in one.flags:
            yield f"                '{_repeats(one)}{flag}[{_zsh(one.help)}]{_zsh_value(one)}' \\"
    if command.words:
        yield f"                '*:word:({' '.join(command.words)})' \\"
    yield f"                '*:file:{'_files' if command.takes_files else ' '}'"
    yield "            ;;"


def _repeats(option: Option) -> str:
    return "*" if "repeatable" in option.help else ""


def _zsh_value(option: Option) -> str:
    if not option.value:
        return ""
    action = f"({' '.join(option.choices)})" if option.choices else ""
    if option.takes_file:
        action = "_files"
    name = _zsh(option.value.split(" ")[0])
    return f":{name}:{action or ' '}" * (1 + option.value.count(" "))


def _zsh(text: str) -> str:
    """A text in an argument of `_arguments`, in single quotes."""
    for mark in "\\[]:":
        text = text.replace(mark, f"\\{mark}")
    return text.replace("'", "'\\''").replace("%%", "%")


def fish(commands: list[Command]) -> str:
    """The script for fish: `share/fish/vendor_completions.d/modlens.fish`."""
    lines = ["# Completion of modlens for fish; made of its parsers."]
    for one in commands:
        lines.append(
            f"complete -c modlens -n __fish_use_subcommand -a {one.name} -d {_fish(one.summary)}"
        )
    for command in commands:
        seen = f"'__fish_seen_subcommand_from {command.name}'"
        if not command.takes_files:
            lines.append(f"complete -c modlens -n {seen} -f")
        if command.words:
            lines.append(f"complete -c modlens -n {seen} -a {_fish(' '.join(command.words))}")
        lines += [
            f"complete -c modlens -n {seen} {_fish_option(one)}"
            for one in command.options
            if one.flags
        ]
    return "\n".join([*lines, ""])


def _fish_option(option: Option) -> str:
    words = [
        f"-l {flag[2:]}" if flag.startswith("--") else f"-s {flag[1:]}" for flag in option.flags
    ]
    if option.choices:
        words.append(f"-x -a {_fish(' '.join(option.choices))}")
    elif option.value:
        words.append("-r" if option.takes_file else "-x")
    return " ".join([*words, f"-d {_fish(option.help)}"])


def _fish(text: str) -> str:
    plain = text.replace("%%", "%").replace("\\", "\\\\").replace("'", "\\'")
    return f"'{plain}'"
