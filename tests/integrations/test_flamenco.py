"""The Flamenco job type: the tasks that it makes of a job, in a JavaScript engine with what Flamenco gives scripts."""

import json
from pathlib import Path
from typing import Any

import pytest

quickjs = pytest.importorskip("quickjs", reason="the extra dev has a JavaScript engine, quickjs-ng")

SCRIPT = Path(__file__).parents[2] / "integrations" / "flamenco" / "fpsboost.js"

FLAMENCO = """
"use strict";
const author = {
    Task: (name, type) => ({
        name, type, commands: [], dependencies: [],
        addCommand(command) { this.commands.push(command); },
        addDependency(task) { this.dependencies.push(task.name); },
    }),
    Command: (name, parameters) => ({ name, parameters }),
};
const shellSplit = text => text.split(" ").filter(each => each);
"""
"""What Flamenco gives job types, as far as this one uses it."""

COMPILE = """
(function (settings) {
    const tasks = [];
    compileJob({ settings, addTask(task) { tasks.push(JSON.parse(JSON.stringify(task))); } });
    return JSON.stringify(tasks);
})
"""

SETTINGS = {
    **{"input": "/films/in film.mov", "output": "/films/out.mp4"},
    **{"options": "--factor 2 --threads 8", "parts": 3, "command": "fpsboost"},
}


@pytest.fixture
def engine() -> Any:
    """A JavaScript engine that has loaded the job type."""
    context = quickjs.Context()
    context.eval(FLAMENCO + SCRIPT.read_text(encoding="utf-8"))
    return context


def tasks_of(engine: Any, **settings: Any) -> list[dict[str, Any]]:
    """Return the tasks of a job, as they were when they were added to it."""
    given = json.dumps({**SETTINGS, **settings})
    return json.loads(engine.eval(f"({COMPILE})({given})"))


def test_each_part_is_a_task(engine):
    """Which runs fpsboost for this part alone, goes on where an earlier run was stopped, and waits for nobody."""
    *parts, _ = tasks_of(engine)
    assert [task["name"] for task in parts] == ["part-1", "part-2", "part-3"]
    for number, task in enumerate(parts, start=1):
        files = ["/films/in film.mov", "/films/out.mp4"]
        args = [*files, "--chunk", f"{number}/3", "--resume", "--factor", "2", "--threads", "8"]
        assert task["commands"] == [{"name": "exec", "parameters": {"exe": "fpsboost", "args": args}}]
        assert (task["type"], task["dependencies"]) == ("misc", [])


def test_the_last_task_joins_all_parts(engine):
    """It depends on every part, by dependencies that are there when the task is added, which Flamenco then copies."""
    *parts, last = tasks_of(engine)
    assert last["dependencies"] == [task["name"] for task in parts]
    args = ["join", "/films/out.mp4", "/films/out.mp4.parts"]
    assert last["commands"] == [{"name": "exec", "parameters": {"exe": "fpsboost", "args": args}}]
    assert last["type"] == "misc"


def test_options_may_be_empty_and_the_program_may_be_elsewhere(engine):
    """Without options the arguments end with the part, and all tasks run the program that is named."""
    first, last = tasks_of(engine, options="", parts=1, command="/opt/fpsboost/bin/fpsboost")
    assert first["commands"][0]["parameters"]["args"][-3:] == ["--chunk", "1/1", "--resume"]
    assert {task["commands"][0]["parameters"]["exe"] for task in (first, last)} == {"/opt/fpsboost/bin/fpsboost"}


def test_a_job_without_parts_is_refused(engine):
    """By a text, which Flamenco shows to who submits it."""
    with pytest.raises(quickjs.JSException, match="parts must be at least 1"):
        tasks_of(engine, parts=0)


def test_settings_are_of_the_kinds_that_flamenco_has(engine):
    """Types, subtypes, visibility and keys are those of its API; what tasks need is required or has a default."""
    job_type = json.loads(engine.eval("JSON.stringify(JOB_TYPE)"))
    assert job_type["label"] == "fpsboost"
    settings = {setting.pop("key"): setting for setting in job_type["settings"]}
    assert settings.keys() == SETTINGS.keys()
    for setting in settings.values():
        assert setting["type"] in {"string", "int32", "float", "bool"}
        assert setting.get("subtype", "file_path") in {"file_path", "dir_path", "file_name", "hashed_file_path"}
        assert setting.get("visible", "visible") in {"visible", "hidden", "submission", "web"}
        assert setting.keys() <= {"type", "subtype", "required", "default", "description", "propargs", "visible"}
        assert setting.get("required") or "default" in setting
