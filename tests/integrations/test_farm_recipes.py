"""The recipes for batch systems and render farms: what they show can be read by who is to run it."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fpsboost.cli.app import app

PAGE = Path(__file__).parents[2] / "docs" / "farm.md"
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def blocks_of(*kinds: str) -> list[str]:
    """Return the blocks of the page that are marked as one of these languages."""
    return [text for kind, text in BLOCKS if kind in kinds]


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize("text", blocks_of("sh", "bash"))
def test_shell_recipes_can_be_read_by_a_shell(text):
    """Without being run."""
    checked = subprocess.run(["bash", "-n"], input=text, capture_output=True, text=True, check=False)
    assert (checked.returncode, checked.stderr) == (0, "")


@pytest.mark.parametrize("text", blocks_of("yaml"))
def test_yaml_recipes_are_yaml(text):
    """A mapping each."""
    yaml = pytest.importorskip("yaml", reason="comes with openjd-cli of the extra dev")
    assert isinstance(yaml.safe_load(text), dict)


def commands() -> list[str]:
    """Return every call of fpsboost with files in the page's recipes, with numbers for variables."""
    text = "\n".join(blocks_of("", "sh", "bash", "yaml")).replace("\\\n", " ")
    text = re.sub(r'"\$[^"/]*(/\d+)?"|\{\}(/\d+)', lambda found: f"3{found[1] or found[2] or ''}", text)
    return re.findall(r"fpsboost ((?:join )?\S+ \S*out\.mp4[^\n#&'\"|]*)", text)


@pytest.mark.parametrize("call", commands())
def test_the_command_line_takes_what_recipes_call_it_with(call):
    """Commands, options and files, in every recipe."""
    app.parse_args(shlex.split(call), exit_on_error=False, print_error=False)


def test_every_recipe_makes_parts_and_joins_them():
    """For one machine, ssh, SLURM and PBS, as at the head of the page; Kubernetes joins by a list of words."""
    assert sum(call.startswith("join ") for call in commands()) == 5
    assert sum("--chunk" in call for call in commands()) == 6


def test_the_table_of_predictions_is_that_of_the_script():
    """Every row, so that the page can be made again."""
    script = PAGE.parents[1] / "benchmarks" / "scale.py"
    printed = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True).stdout
    rows = [line for line in printed.splitlines() if line.startswith("|")]
    assert len(rows) == 5
    assert "\n".join(rows) in PAGE.read_text(encoding="utf-8")
