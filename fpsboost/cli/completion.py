"""Command ``fpsboost completion``: prints a script by which a shell completes commands, options, values and files."""

from __future__ import annotations

from typing import Annotated, Literal

from cyclopts import Parameter

Shell = Literal["bash", "zsh", "fish"]

SPLIT_AT_SPACES = 'COMPREPLY=( $(compgen -f -- "${cur}") )'
"""Line of Cyclopts' script for bash that completes names of files, and splits those with spaces."""


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
    if shell != "bash":
        return script
    # where nothing is proposed, bash itself completes names of files, as it does everywhere else
    return script.replace(SPLIT_AT_SPACES, "COMPREPLY=()").replace("\ncomplete -F ", "\ncomplete -o default -F ")
