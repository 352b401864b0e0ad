"""Command ``fpsboost completion``: prints a script by which a shell completes commands, options, values and files."""

from __future__ import annotations

from typing import Annotated, Literal

from cyclopts import Parameter

Shell = Literal["bash", "zsh", "fish"]

SPLIT_AT_SPACES = 'COMPREPLY=( $(compgen -f -- "${cur}") )'
"""Line of Cyclopts' script for bash that completes names of files, and splits those with spaces."""

ZSH_ENTRY = """
_fpsboost() { _cyclopts_fpsboost "$@" || _files }
if [[ "$zsh_eval_context[-1]" == loadautofunc ]]; then
  _fpsboost "$@"
else
  compdef _fpsboost fpsboost
fi
"""
"""Call of the function of Cyclopts' script for zsh: at the first TAB of a file of ``$fpath``, or once it is sourced."""


def completion(shell: Annotated[Shell, Parameter(name="SHELL")], /) -> None:
    """Print the script by which a shell completes what is typed.

    Parameters
    ----------
    shell
        bash, zsh or fish.
    """
    print(completion_script(shell))


def completion_script(shell: Shell) -> str:
    """Return the script for a shell."""
    from fpsboost.cli.app import app  # noqa: PLC0415 (which imports this module)

    script = app.generate_completion(shell=shell)
    if shell == "bash":
        # where nothing is proposed, bash itself completes names of files, as it does everywhere else
        return script.replace(SPLIT_AT_SPACES, "COMPREPLY=()").replace("\ncomplete -F ", "\ncomplete -o default -F ")
    return script + ZSH_ENTRY if shell == "zsh" else script
