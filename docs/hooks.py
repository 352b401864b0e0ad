"""What the site takes from elsewhere when it is built: options of the command line, parts of the repository, formulas.

A line ``<!-- include FILE -->`` in a page stands for a file of the repository, ``<!-- include FILE NAME -->`` for the
part of it between ``<!-- NAME -->`` and ``<!-- /NAME -->``, ``<!-- options -->`` for the options of the command line,
``<!-- conflicts -->`` for those that exclude each other, and ``<!-- gallery -->`` for the comparison pages that are
there. Formulas become MathML, which browsers show without a program. What does not fit together stops the build.
"""

from __future__ import annotations

import html
import posixpath
import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError

import fpsboost
from fpsboost.cli.app import app
from fpsboost.cli.flags import in_flags
from fpsboost.conflicts import CONFLICTS, LEAVE_ONE, NEEDS, in_sentence

ROOT = Path(__file__).parents[1]


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Insert included files and options into a page, and check the commands and names that it shows."""
    markdown = re.sub(r"<!-- include (\S+)(?: (\w+))? -->", lambda found: included(*found.groups()), markdown)
    for line in re.findall(r"^fpsboost [^\n=].*$", markdown, re.MULTILINE):
        check_command(line, page.file.src_path)
    if page.file.src_path == "python.md":
        check_names(markdown)
    made = {"options": options, "conflicts": conflicts, "gallery": gallery}
    return re.sub(rf"<!-- ({'|'.join(made)}) -->", lambda found: made[found[1]](), markdown)


def on_page_content(content: str, page: Any, config: Any, files: Any) -> str:
    """Turn formulas into MathML."""
    content = re.sub(
        r'<div class="arithmatex">\\\[(.*?)\\\]</div>',
        lambda found: f'<div class="formula">{convert(html.unescape(found[1]).strip(), display="block")}</div>',
        content,
        flags=re.DOTALL,
    )
    return re.sub(
        r'<span class="arithmatex">\\\((.*?)\\\)</span>',
        lambda found: convert(html.unescape(found[1])),
        content,
        flags=re.DOTALL,
    )


def included(path: str, part: str | None) -> str:
    """Return a file of the repository, or a part of it, with its links adapted to the site."""
    text = (ROOT / path).read_text("utf-8")
    if part is not None:
        found = re.search(rf"<!-- {part} -->\n(.*?)<!-- /{part} -->", text, re.DOTALL)
        if found is None:
            raise PluginError(f"{path} has no part {part}.")
        text = found[1]

    def relinked(link: re.Match[str]) -> str:
        title, target = link.groups()
        if re.match(r"\w+:|#", target):
            return link[0]
        place = posixpath.normpath(posixpath.join(posixpath.dirname(path), target))
        if place.startswith("docs/"):
            return f"[{title}]({place.removeprefix('docs/')})"
        return f"`{place}`"

    return re.sub(r"\[([^\]\n]*)\]\(([^)\s]+)\)", relinked, text).strip()


def gallery() -> str:
    """Return links to the comparison pages that `docs/make_gallery.py` has written here, and the command that does."""
    pages = sorted((ROOT / "docs" / "gallery").glob("*/index.html"))
    links = ", ".join(f"[{page.parent.name}](gallery/{page.parent.name}/index.html)" for page in pages)
    shown = f"Comparisons of several methods on these clips: {links}. " if pages else ""
    return f"{shown}`python docs/make_gallery.py` renders these clips, and writes a comparison page of each."


def options() -> str:
    """Return the reference of all commands and options that the command line generates."""
    text = app.generate_docs(output_format="markdown", recursive=True, heading_level=2)
    _, text = text.split("**Arguments**", 1)  # its own title and contents
    text = re.sub(r"\*\*Commands\*\*:\n\n(?:\* .*\n)+", "", text)
    return f"## fpsboost\n\n**Arguments**{text}".replace("docs/comparison.md", "[this page](comparison.md)")


def conflicts() -> str:
    """Return the tables of options that cannot be combined, and of those that need another."""
    lines = ["| options | not with | because |", "|---|---|---|"]
    for options, others, reason, advice, unless in CONFLICTS:
        way = "" if advice == LEAVE_ONE else f"; {advice}"
        exception = f", unless with {listed((unless,))}" if unless else ""
        lines.append(f"| {listed(options)} | {listed(others)}{exception} | {with_flags(reason)}{way} |")
    lines += ["", "| option | only with |", "|---|---|"]
    return "\n".join(lines + [f"| {listed((option,))} | {listed(others)} |" for option, others in NEEDS.items()])


def listed(names: Sequence[str]) -> str:
    """Return options and uses in an entry of these tables, options as flags."""
    return with_flags(", ".join(map(in_sentence, names)))


def with_flags(text: str) -> str:
    """Return a text with flags between backquotes in place of fields."""
    return re.sub("`[^`]+`", lambda found: f"`{in_flags(found[0]).strip('`')}`", text)


def check_command(line: str, page: str) -> None:
    """Raise `PluginError` unless the command line accepts a command that a page shows."""
    tokens = shlex.split(re.split(r"\s#\s|\s{2,}", line)[0])[1:]
    if tokens == ["--help"]:
        return
    try:
        app.parse_args(tokens, exit_on_error=False, print_error=False)
    except Exception as error:
        raise PluginError(f"{page} shows a command that does not work: {line} ({error})") from error


def check_names(markdown: str) -> None:
    """Raise `PluginError` unless a page describes all public names and no others."""
    described = set(re.findall(r"^::: fpsboost\.(\w+)$", markdown, re.MULTILINE))
    public = set(fpsboost.__all__) - {"__version__"}
    if described != public:
        raise PluginError(f"python.md and fpsboost.__all__ differ in {', '.join(sorted(described ^ public))}.")
