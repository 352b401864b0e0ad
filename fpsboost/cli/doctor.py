"""Command ``fpsboost doctor``: checks whether fpsboost works on this machine, and gives advice where it does not."""

from __future__ import annotations

import json as plain
import sys
from dataclasses import asdict
from itertools import groupby
from operator import attrgetter
from typing import Annotated

from cyclopts import Group, Parameter
from rich.console import Console
from rich.table import Column, Table

from fpsboost import diagnosis
from fpsboost.cli.messages import console, literal

MAX_WIDTH = 100

options = Group("Options", sort_key=1)


def doctor(*, json: Annotated[bool, Parameter(group=options)] = False) -> None:
    """Check whether fpsboost works on this machine.

    Parameters
    ----------
    json
        Print JSON.
    """
    with Console(stderr=True, quiet=json).status("checking"):
        findings = list(diagnosis.diagnose())
    broken = [finding for finding in findings if finding.advice]
    if json:
        print(plain.dumps({"works": not broken, "findings": [asdict(finding) for finding in findings]}, indent=1))
    else:
        out = Console(highlight=False)
        out.width = min(out.width, MAX_WIDTH)
        names = Column(style="bold", no_wrap=True), Column(style="dim", no_wrap=True)
        values = Column(overflow="fold"), Column(no_wrap=True)
        table = Table(*names, *values, box=None, pad_edge=False, show_header=False)
        for part, group in groupby(findings, key=attrgetter("part")):
            for place, finding in enumerate(group):
                state = "[red]fails[/]" if finding.advice else "[green]ok[/]"
                table.add_row(part if place == 0 else "", finding.name, literal(finding.value), state)
        out.print(table)
        if not broken:
            out.print("[green]Everything works.[/]")
    errors = console()
    for finding in broken:
        errors.print(f"[red]fpsboost:[/] {literal(finding.advice)}")
    if broken:
        sys.exit(1)
