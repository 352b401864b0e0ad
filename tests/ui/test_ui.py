"""The page of `fpsboost ui`: who may use it and for what, its queue, and a conversion from start to result."""

import asyncio
import base64
import json
import os
import re
import shutil
import socket
import subprocess
import sys
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict
from http.client import HTTPConnection
from itertools import chain, product
from pathlib import Path
from threading import Event, Thread

import av
import cv2
import numpy as np
import pytest
import uvicorn
from playwright.sync_api import expect
from starlette.testclient import TestClient

from fpsboost.errors import OptionError, OutputError
from fpsboost.media.staging import MANIFEST, hidden_place
from fpsboost.ui import choices, jobs
from fpsboost.ui.choices import LABELS, first_choices, on_page
from fpsboost.ui.files import MAX_ENTRIES, Files
from fpsboost.ui.jobs import MAX_JOBS, Queue
from fpsboost.ui.server import MAX_BODY, READERS, UiSession, make_app, with_key
from support.browser import violations
from support.video_truth import add_pictures, mux_in_order, scene, tone, write_clip

TOKEN, PORT = "the-token-of-this-run", 8517
ADDRESS = f"http://127.0.0.1:{PORT}"
HEADERS = {"x-fpsboost-token": TOKEN, "origin": ADDRESS}
SAFE = {"cache-control": "no-store", "referrer-policy": "no-referrer", "x-content-type-options": "nosniff"}
POSTS = ("/folder", "/find", "/pick", "/probe", "/place", "/check", "/look", "/add", "/change")
GETS = ("/jobs", "/result/1", "/source/1", "/poster/1")

STOPPED_AT_TEN = """
import json, signal, sys
def stop(*_):
    print(json.dumps({"frames": 20, "stage": "stopped", "finished": 10}), file=sys.stderr)
    print("Stopped; 10 of 20 frames are finished, and --resume goes on from there.", file=sys.stderr)
    sys.exit(130)
signal.signal(signal.SIGTERM, stop)
print(json.dumps({"frame": 10, "frames": 20, "fps": 5.0, "stage": "converting"}), file=sys.stderr, flush=True)
signal.pause()
"""
"""A conversion that has made ten frames and waits to be stopped."""


@pytest.fixture
def films(tmp_path):
    """A folder with one clip of ten frames, in a folder with another clip."""
    folder = tmp_path / "films"
    folder.mkdir()
    shutil.copy(write_clip(folder / "clip.mp4"), tmp_path / "secret.mp4")
    return folder.resolve()


@pytest.fixture
def session(films, tmp_path):
    """What the page works with, allowed nothing but that folder."""
    files = Files(films)
    with closing(Queue(tmp_path / "state" / "queue.json", files)) as queue:
        yield UiSession(files, queue, films, TOKEN, PORT)


@pytest.fixture
def client(session):
    return TestClient(make_app(session), base_url=ADDRESS, headers=HEADERS)


def notice(client, path, data):
    """The sentence with which a request is refused."""
    answer = client.post(path, json={"clips": [data]} if path in ("/check", "/add") else data)
    assert answer.status_code == 400, answer.text
    return str(answer.json()["notice"])


def check(client, choices):
    """What a conversion would give."""
    return client.post("/check", content=json.dumps({"clips": [choices]})).json()["clips"][0]


def add(client, choices):
    """The number of a conversion that is put into the queue."""
    return client.post("/add", json={"clips": [choices]}).json()["numbers"][0]


def form(client, films, **changes):
    """What the page sends of the clip, which is picked."""
    picked = client.post("/pick", json={"path": str(films / "clip.mp4")}).json()
    return {**picked["choices"], "method": "nearest", **changes}


def write_sounds(path):
    """Write a clip with two sounds."""
    with av.open(str(path), "w") as output:
        _, packets = add_pictures(output)
        sounds = [output.add_stream("aac", rate=48000) for _ in range(2)]
        mux_in_order(output, [*packets, *chain(*map(tone, sounds))])


def until(queue, state, frame=0):
    """The only job, as soon as it is in a state and has made so many frames."""
    with queue._changed:
        assert queue._changed.wait_for(
            lambda: any(job["state"] == state and job["frame"] >= frame for job in queue.listing()), 60
        ), queue.listing()
        return queue.listing()[0]


# ---------------------------------------------------------------- who may use it


def test_token_is_needed(session):
    """Every request but for the page, which tells nothing, needs the token of this run, or a key to its own address."""
    client = TestClient(make_app(session), base_url=ADDRESS, headers={"origin": ADDRESS})
    keys = [f"key={TOKEN}", f"token={TOKEN}", "", "%ff", with_key("/result/2", TOKEN)[10:], with_key("/jobs", "x")[6:]]
    for path, key, token in product([*POSTS, *GETS], keys, ["", "another", TOKEN[:-1], "\xff"]):
        headers = {"x-fpsboost-token": token.encode("latin-1")} if token else {"cookie": f"fpsboost-token={TOKEN}"}
        asked = with_key(path, TOKEN) if path in POSTS else f"{path}?{key}"
        answer = client.request("POST" if path in POSTS else "GET", asked, headers=headers)
        assert (answer.status_code, "The token is not that of this run" in answer.text) == (403, True)
    assert (TOKEN in client.get("/").text, client.get(with_key("/result/1", TOKEN)).status_code) == (False, 400)


@pytest.mark.parametrize(
    "host", ["example.com", f"example.com:{PORT}", "127.0.0.1", "127.0.0.1:1", f"0.0.0.0:{PORT}", ""]
)
def test_no_other_name_leads_here(client, host):
    """Requests under another name than this machine's own are refused, even with the token."""
    got = client.get("/", headers={"host": host})
    assert (got.status_code, f'<a href="{ADDRESS}/">' in got.text, TOKEN in got.text) == (403, True, False)


@pytest.mark.parametrize("path", POSTS)
@pytest.mark.parametrize(
    "origin", ["http://example.com", "null", f"https://127.0.0.1:{PORT}", "http://127.0.0.1:1", ""]
)
def test_no_other_page_asks_for_anything(client, origin, path):
    """What changes or reads anything must come from the page itself, even with the token."""
    answer = client.post(path, json={}, headers={"origin": origin})
    assert (answer.status_code, "Another page has sent this" in answer.text) == (403, True)


def test_page_is_kept_by_nobody_and_runs_its_own_script_alone(client):
    """The page and answers are not stored, addresses go nowhere, and only the script with the nonce runs."""
    page = client.get("/")
    policy = page.headers["content-security-policy"]
    (nonce,) = set(re.findall(r' nonce="(.*?)"', page.text))
    rules = {"default-src 'none'", "frame-ancestors 'none'", f"script-src 'nonce-{nonce}'"}
    assert rules <= {part.strip() for part in policy.split(";")}
    assert client.get("/").headers["content-security-policy"] != policy
    for answer in (page, client.get("/jobs"), client.get("/nowhere"), client.get("/", headers={"host": "x"})):
        assert {name: answer.headers[name] for name in SAFE} == SAFE


@pytest.mark.parametrize("body", [b"x" * (MAX_BODY + 1), iter([b"x" * MAX_BODY, b"x"])], ids=["known", "unknown"])
def test_body_has_a_limit(client, body):
    """A request that is too large is refused, also one whose header gives no size."""
    notice = f"The page has sent more than {MAX_BODY} bytes; reload it."
    assert client.post("/folder", content=body).json() == {"notice": notice}


# ---------------------------------------------------------------- what it may read and write


def test_folder_lists_folders_and_clips(films):
    """Folders come first, then clips with their sizes; images are counted; hidden and other files are left out."""
    (films / "b").mkdir()
    for name in (".hidden.mp4", "notes.txt", "A.MKV", "1.png", "2.exr"):
        (films / name).write_bytes(b"123")
    found = Files(films).listing(str(films))
    assert [f"{each['kind']} {each['name']}" for each in found["entries"]] == [
        "folder b",
        "clip A.MKV",
        "clip clip.mp4",
    ]
    assert (found["images"], found["left_out"], found["entries"][1]["size"]) == (2, 0, 3)
    for files, above in ((Files(films), [films]), (Files(), [*reversed(films.parents), films])):
        assert [each["path"] for each in files.listing(str(films))["above"]] == list(map(str, above))


def test_long_folders_are_cut(films):
    """No more than a page can show is listed, and the rest is counted."""
    for number in range(MAX_ENTRIES + 2):
        (films / f"{number}.mp4").touch()
    found = Files().listing(str(films))
    assert (len(found["entries"]), found["left_out"]) == (MAX_ENTRIES, 3)


@pytest.mark.parametrize("door", ["/folder", "/pick"])
def test_nothing_outside_of_the_root(client, films, door):
    """No path leads out of the folder that was given, whether up, by a link, or absolute; others are no crash."""
    (films / "link").symlink_to(films.parent)
    (films / "loop").symlink_to(films / "loop")
    for path in ("..", "../secret.mp4", "link", "link/secret.mp4", "/", "~"):
        given = path if path in ("/", "~") else str(films / path)
        assert f"lies outside of {films}" in notice(client, door, {"path": given})
    for path in ("loop", "a\0b", "x" * 5000):
        assert notice(client, door, {"path": str(films / path)})


def test_only_what_was_picked_is_read(client, films):
    """A clip that was not picked is neither probed nor shown nor converted."""
    choices = asdict(first_choices(str(films / "clip.mp4")))
    asked = {"/probe": {"path": choices["input"]}, "/look": {"choices": choices, "time": 0}}
    asked |= {"/place": {"path": choices["input"], "text": "0"}}
    asked |= {"/check": choices, "/add": choices}
    said = {notice(client, path, data) for path, data in asked.items()}
    assert said == {f"{films / 'clip.mp4'} was not picked on this page; pick it first."}


def test_links_inside_a_folder_of_images(client, films, save_images):
    """Images that are links to outside are not read, and no link out is listed; links within the folder are fine."""
    save_images(films.parent / "other")
    save_images(films / "shot", count=4)
    (films / "shot" / "shot_0005.png").symlink_to(films / "shot" / "shot_0001.png")
    choices = client.post("/pick", json={"path": str(films / "shot")}).json()["choices"]
    assert check(client, choices)["frames"] == 9
    (films / "shot" / "shot_0006.png").symlink_to(films.parent / "other" / "shot_0005.png")
    (films / "out.mp4").symlink_to(films.parent / "secret.mp4")
    said = f"{films}/shot/shot_0006.png is a link to outside of {films}; remove it, or pick another."
    for path, data in {"/check": choices, "/add": choices, "/look": {"choices": choices, "time": 0}}.items():
        assert notice(client, path, data) == said
    for path in ("shot", "shot/shot_%04d.png"):
        assert notice(client, "/pick", {"path": str(films / path)}) == said
    assert client.post("/folder", json={"path": str(films / "shot")}).json()["images"] == 5
    listed = client.post("/folder", json={"path": str(films)}).json()["entries"]
    assert [each["name"] for each in listed] == ["shot", "clip.mp4"]
    wrong = str(films / "shot" / "shot.mp4")  # for whose absence the links beside it are not to blame
    assert re.match(f"{wrong} does not exist|Cannot read {wrong}", notice(client, "/pick", {"path": wrong}))
    (films / "outside").symlink_to(films.parent)
    size = (films / "clip.mp4").stat().st_size
    dropped = [{"name": name, "size": size} for name in ("secret.mp4", "a\0", "x" * 5000)] + [{"name": "no.mp4"}]
    found = client.post("/find", json={"files": [*dropped, {"name": "clip.mp4", "size": size}]}).json()
    assert (found["paths"], len(found["missing"])) == ([str(films / "clip.mp4")], 4)


def test_jobs_outside_of_the_root_wait(films, tmp_path):
    """A conversion of an earlier start that reads or writes outside is kept and not run, and others go on."""
    there, here = str(tmp_path / "secret.mp4"), str(films / "clip.mp4")
    words = [(there, f"{films}/a.mp4"), (here, str(tmp_path / "b.mp4")), (here, f"{films}/c.mp4")]
    path = tmp_path / "queue.json"
    kept = [asdict(jobs.Job(number, ["fpsboost", *each], each[1])) for number, each in enumerate(words, 1)]
    path.write_text(json.dumps(kept))
    with closing(Queue(path, Files(films))) as queue:
        assert ([each["number"] for each in queue.listing()], len(queue.outside)) == ([3], 2)
        with pytest.raises(OptionError, match="no job 1"):
            queue.resume(1)
        queue.remove(3)
    with closing(Queue(path)) as queue:
        assert [Path(each["output"]).name for each in queue.listing()] == ["a.mp4", "b.mp4"]


def test_input_that_became_a_link_is_not_converted(session, client, films):
    """What was picked is not read if it has become a link to somewhere else, nor by a conversion that waited."""
    choices = form(client, films)
    (films / "clip.mp4").unlink()
    (films / "clip.mp4").symlink_to(films.parent / "secret.mp4")
    assert "lies outside of" in notice(client, "/check", choices)
    session.queue.add(["fpsboost", choices["input"], str(films / "out.mp4")])
    assert "lies outside of" in until(session.queue, "failed")["message"]


@pytest.mark.parametrize("name", ["../out.mp4", "a/b.mp4", "..", "../", ".", "", "a\\b.mp4", "/out.mp4", "a\0.mp4"])
def test_output_is_a_name_in_its_folder(client, films, name):
    """The name of an output leads nowhere else."""
    assert notice(client, "/check", form(client, films, name=name)).startswith(f"{name!r} is not a file name")


def test_output_is_no_link(client, films):
    """Nothing is written through a link, not even if it may be replaced."""
    for path in (films / "out.mp4", hidden_place(films, "out.mp4")):
        path.symlink_to(films.parent)
        said = notice(client, "/add", form(client, films, name="out.mp4", overwrite=True))
        assert said == f"{films / 'out.mp4'} is a link to another place, or was begun there; choose another name."
        path.unlink()
    assert "lies outside of" in notice(client, "/check", form(client, films, folder=str(films.parent)))


@pytest.mark.parametrize(
    ("changes", "arguments"),
    [
        ({"rate": "fps", "value": "0"}, ["--fps", "0"]),
        ({"rate": "factor", "value": "two"}, ["--factor", "two"]),
        ({"rate": "slow", "value": "0"}, ["--factor", "0", "--slow-motion"]),
        ({"rate": "retime", "value": "0=0 1s=9s"}, ["--retime", "0=0 1s=9s"]),
        ({"method": "magic"}, ["--method", "magic"]),
        ({"start": "soon"}, ["--start", "soon"]),
        ({"start": "2", "end": "1"}, ["--start", "2", "--end", "1"]),
        ({"codec": "h246", "quality": "lossless"}, ["--codec", "h246", "--lossless"]),
        ({"name": "out.webm", "codec": "h264"}, ["--codec", "h264"]),
        ({"name": "out.avi"}, []),
        ({"name": "out"}, []),
        ({"name": "out.gif", "quality": "smaller"}, ["--crf", "20"]),
        ({"name": "out.png"}, []),
        ({"name": "clip.mp4"}, []),
        ({"input_fps": "24"}, ["--input-fps", "24"]),
    ],
)
def test_page_and_command_line_say_the_same(client, films, fpsboost_, changes, arguments):
    """What is wrong with a form is said as on the command line, with the form's words for options."""
    choices = form(client, films, name="out.mp4") | changes
    if "method" not in changes:
        arguments = ["--method", "nearest", *arguments]
    expected = fpsboost_(str(films / "clip.mp4"), str(films / choices["name"]), *arguments)
    assert expected.code != 0
    said = notice(client, "/check", choices)
    assert f"fpsboost: {said}" == on_page(expected.err.strip())
    assert "--" not in said


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("leave it out with `audio=False`.", "leave it out with “Keep the sound” cleared."),
        ("it is there; add `overwrite`.", "it is there; add a tick at “Replace it if it exists”."),
        ("9 frames are finished, and --resume goes on.", "9 frames are finished, and “Try again” goes on."),
        ("a--fps.mp4 (see `fps`) is there.", "a--fps.mp4 (see “Frames a second”) is there."),
        ("add it, or give `fill_gaps`.", "add it, or give --fill-gaps. What begins with -- is for a command line."),
    ],
)
def test_sentences_speak_of_the_page(said, shown):
    """What the page has is called as on the page, and what it has not is said to be for a command line."""
    assert on_page(said) == shown


def test_labels_are_on_the_page():
    """What sentences call the page's options is written there."""
    page = "".join(path.read_text() for path in Path(choices.__file__).parent.joinpath("templates").iterdir())
    assert [label for label in re.findall("“(.*?)”", " ".join(LABELS.values())) if label not in page] == []


@pytest.mark.parametrize("path", ["broken.mp4", "missing.mp4", "empty"])
def test_bad_clips_are_said_as_on_the_command_line(client, films, fpsboost_, path):
    """So is what is wrong with a clip."""
    (films / "broken.mp4").write_bytes(b"no video" * 100)
    (films / "empty").mkdir()
    expected = fpsboost_("probe", str(films / path))
    assert f"fpsboost: {notice(client, '/pick', {'path': str(films / path)})}\n" == expected.err


def test_nonsense_is_answered_with_a_sentence(client):
    """A request that no page would send ends with a sentence and not with an error of the server."""
    for path, body in [
        ("/folder", b"{"),
        ("/find", b'{"files": ["clip.mp4"]}'),
        ("/pick", b"[]"),
        ("/pick", b'{"path": 3}'),
        ("/check", b"null"),
        ("/check", b'{"clips": []}'),
        ("/check", b'{"clips": [{"input": 1}]}'),
        ("/add", b'{"clips": [{"input": "a", "unknown": "b"}, 2]}'),
        ("/look", b'{"choices": {}, "time": "now"}'),
        ("/change", b'{"number": true, "action": "pause"}'),
        ("/change", b'{"number": 1, "action": "explode"}'),
        ("/change", b'{"number": 1, "action": "pause"}'),
        ("/change", b'{"number": 1, "action": []}'),
        ("/change", b'{"number": %s, "action": "pause"}' % (b"9" * 5000)),
        ("/folder", b'{"path": "\\ud800"}'),
        ("/folder", b'{"path": "\xff"}'),
        ("/folder", b"[" * 50_000),
        ("/look", b'{"choices": {}, "time": 1e999}'),
        *((f"/result/{number}", None) for number in ("9" * 5000, "-1", "x", "%ff", "%C2%B2")),
    ]:
        answer = client.request("GET" if body is None else "POST", path, content=body)
        assert (answer.status_code, answer.json()["notice"][-1]) == (400, ".")


def test_client_may_hang_up(session):
    """A client that is gone before its request has come is no error."""

    async def gone(*_):
        return {"type": "http.disconnect"}

    headers = [(name.encode(), value.encode()) for name, value in {**HEADERS, "host": ADDRESS[7:]}.items()]
    scope = {"type": "http", "method": "POST", "path": "/folder", "query_string": b"", "headers": headers}
    asyncio.run(make_app(session)(scope, gone, gone))


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere names of files are Unicode")
def test_names_need_not_be_unicode(client, films):
    """A file is listed, picked and checked under a name that is no UTF-8."""
    (films / "clip.mp4").rename(films / "\udcff.mp4")
    (entry,) = client.post("/folder", json={}).json()["entries"]
    choices = client.post("/pick", content=json.dumps({"path": entry["path"]})).json()["choices"]
    assert check(client, choices)["frames"] == 20


@pytest.mark.parametrize("time", [-1, float("nan"), 1e30, True, "1"])
def test_times_are_checked(client, films, time):
    """A place in a clip is a number of seconds."""
    answer = client.post("/look", content=json.dumps({"choices": form(client, films), "time": time}))
    assert answer.json() == {"notice": "The page has sent no valid time; reload it."}


# ---------------------------------------------------------------- what it says and shows


def test_form_says_what_comes_out(client, films):
    """The frames, the rate, the length and the command line of a conversion, before it is done."""
    changes = {
        "rate": "slow",
        "value": "4",
        "loop": True,
        "start": "2f",
        "codec": "hevc",
        "quality": "smaller",
        "name": "it's.mkv",
    }
    assert "has ended where “From” 99 s would be" in notice(client, "/check", form(client, films, start="99"))
    found = check(client, form(client, films, **changes, subtitles=False))
    assert found.pop("command") == (
        f"fpsboost {films}/clip.mp4 '{films}/it'\"'\"'s.mkv' --factor 4 --slow-motion --loop --method nearest "
        "--start 2f --codec hevc --crf 26 --no-subtitles"
    )
    assert (found["frames"], found["rate"], found["remarks"]) == (32, 25.0, [])


def test_streams_are_chosen_and_what_is_lost_is_said_before(client, films):
    """Of several sounds, some are kept by their numbers; what becomes of them is said before any work."""
    write_sounds(films / "clip.mp4")
    picked = client.post("/pick", json={"path": str(films / "clip.mp4")}).json()
    assert [each["kind"] for each in picked["streams"]] == ["video", "audio", "audio"]
    found = check(client, form(client, films, name="out.webm", streams="2"))
    assert "--streams 2 " in f"{found['command']} "
    (said,) = found["remarks"]
    assert re.fullmatch(r"out.webm would hold stream 2 \(aac sound\) of its source encoded anew as opus.*\.", said)
    said = notice(client, "/check", form(client, films, streams="1,5"))
    assert said.startswith(f"“Streams to keep” 5 is no sound and no subtitles of {films}/clip.mp4, which has 1 (aac ")


@pytest.mark.slow
def test_images_become_images(client, films, save_images):
    """A folder of images is picked, looked at by names, and by default becomes one; as a video it needs a rate."""
    save_images(films / "shot")
    found = client.post("/pick", json={"path": str(films / "shot")}).json()
    assert (found["is_images"], found["choices"]["name"]) == (True, "shot-2x/")
    assert check(client, found["choices"])["frames"] == 9
    as_video = {**found["choices"], "name": "shot.mp4"}
    assert "say it with “Frame rate of the images”" in notice(client, "/check", as_video)
    assert found["last"] == 4
    for time, between in enumerate([(1, 2), (2, 3), (3, 4), (4, 5), (4, 5), (4, 5)]):
        shown = client.post("/look", json={"choices": {**found["choices"], "method": "blend"}, "time": time}).json()
        assert shown["between"] == "between shot_{:04}.png and shot_{:04}.png".format(*between)
    assert client.post("/probe", json={"path": found["choices"]["input"]}).json()["last"] == 4
    assert check(client, {**as_video, "input_fps": "24"})["rate"] == 48


@pytest.mark.slow
def test_probe_says_what_the_command_says(client, films):
    """Of Matroska and cut-off files, the page learns only by reading to the end how far its slider reaches."""
    write_clip(films / "clip.mkv")
    assert client.post("/pick", json={"path": str(films / "clip.mkv")}).json()["last"] is None
    found = client.post("/probe", json={"path": str(films / "clip.mkv")}).json()
    assert found["facts"]["frames"] == "10"
    assert found["streams"][0]["codec"] == "h264"
    assert found["last"] == pytest.approx(client.post("/pick", json={"path": str(films / "clip.mp4")}).json()["last"])


@contextmanager
def posted(address, path, data):
    """The connection of a request whose answer has not been read, open while the block lasts."""
    with closing(HTTPConnection(address.split("/")[2])) as connection:
        origin, _, token = address.partition("/#")
        connection.request("POST", path, json.dumps(data), {"x-fpsboost-token": token, "origin": origin})
        yield connection


def posted_whole(address, path, data):
    """The answer of a request."""
    with posted(address, path, data) as connection:
        return json.loads(connection.getresponse().read())


@pytest.mark.slow
def test_probes_of_two_tabs(films, tmp_path, monkeypatch):
    """A clip that one tab reads to its end is not dropped for another tab's, but when its own tab leaves it."""
    real, begun, waiting = jobs.start_process, Event(), list[subprocess.Popen[str]]()

    def start(words, stdout):
        if waiting:
            return real(words, stdout)
        command = [sys.executable, "-c", "import signal; signal.pause()"]
        waiting.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8"))
        begun.set()
        return waiting[0]

    monkeypatch.setattr("fpsboost.ui.clip.start_process", start)
    data = {"path": str(films / "clip.mp4")}
    with serving(films, tmp_path / "queue.json") as address:
        posted_whole(address, "/pick", data)
        with posted(address, "/probe", data):
            assert begun.wait(60)
            assert posted_whole(address, "/probe", data)["facts"]["frames"] == "10"
            assert waiting[0].poll() is None
        waiting[0].wait(60)


def test_looks_wait_apart(films, tmp_path, monkeypatch):
    """A slow frame holds up no other; however many are waited for, all else is answered; those left are not made."""
    begun, ready, times = Event(), Event(), list[float]()

    def look(job, time):
        times.append(time)
        begun.set()
        ready.wait(0 if time else 60)
        raise ZeroDivisionError

    monkeypatch.setattr("fpsboost.ui.server.preview_between", look)
    with serving(films, tmp_path / "queue.json") as address, ExitStack() as looks:
        choices = {"choices": posted_whole(address, "/pick", {"path": str(films / "clip.mp4")})["choices"]}
        for number in range(50):
            looks.enter_context(posted(address, "/look", {**choices, "time": 0}))
            if not number:
                assert begun.wait(60)  # the slow frame comes first
                posted_whole(address, "/look", {**choices, "time": 1})
        assert posted_whole(address, "/folder", {})["above"]
        looks.pop_all().close()
        posted_whole(address, "/folder", {})  # by its answer, the server has seen that the others are gone
        with posted(address, "/look", {**choices, "time": 50}) as last:
            ready.set()
            assert json.loads(last.getresponse().read())["notice"].startswith("This is a fault in fpsboost (ZeroDiv")
    assert (times[0], 1 in times, times[-1], times.count(0) <= READERS) == (0, True, 50, True)


def picture_of(data):
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)


def test_look_shows_the_frame_between(client, films):
    """Blending is the mean of the two frames around the time, and the method's own frame stands beside it.

    The first pair is shown as well, and the last one behind it.
    """
    choices, last = form(client, films), "between 0:00.320 and 0:00.360"
    found = client.post("/look", json={"choices": choices, "time": 0.1}).json()
    blended, made = (picture_of(base64.b64decode(uri.partition(",")[2])) for uri in found["images"])
    frames = [scene(number).astype(float) for number in (2, 3)]
    assert np.abs(blended - sum(frames) / 2).mean() < 4
    assert min(np.abs(made - each).mean() for each in frames) < 4
    assert (found["between"], found["is_cut"]) == ("between 0:00.080 and 0:00.120", False)
    for time, pair in {0: "between 0:00.000 and 0:00.040", 0.36: last, 99: last}.items():
        assert client.post("/look", json={"choices": choices, "time": time}).json()["between"] == pair


def test_positions_are_typed_as_in_options(client, films, save_images):
    """Seconds, times and frames; of images, a bare number is their count from 1."""
    save_images(films / "shot")
    for name, typed in {
        "clip.mp4": {"0.2": 0.2, "0.2s": 0.2, "0:00.2": 0.2, "5f": 0.2},
        "shot": {"3": 2, "2f": 2},
    }.items():
        path = client.post("/pick", json={"path": str(films / name)}).json()["choices"]["input"]
        for text, place in typed.items():
            assert client.post("/place", json={"path": path, "text": text}).json() == {"time": pytest.approx(place)}
        assert "is not a position in a clip; write" in notice(client, "/place", {"path": path, "text": "soon"})


# ---------------------------------------------------------------- the queue


@pytest.mark.slow
def test_job_becomes_a_file_that_plays(client, session, films):
    """The page gets the result in parts as a player asks for them, and nothing else in its place."""
    number = add(client, form(client, films))
    job, output = until(session.queue, "done"), films / "clip-2x.mp4"
    assert (job["frame"], job["frames"], job["message"]) == (20, 20, "")
    part = client.get(f"/result/{number}", headers={"range": "bytes=0-99"})
    assert (part.status_code, part.content) == (206, output.read_bytes()[:100])
    poster = client.get(client.get("/jobs").json()[0]["media"]["poster"], headers={"x-fpsboost-token": ""}).content
    assert np.abs(picture_of(poster) - scene(5).astype(float)).mean() < 4
    output.rename(films / "kept.mp4")
    assert client.get(f"/result/{number}").status_code == 400
    output.symlink_to(films / "clip.mp4")
    assert client.get(f"/result/{number}").json() == {"notice": f"{output} is no longer the file that was written."}
    (films / "kept.mp4").replace(output)
    assert client.post("/change", json={"number": number, "action": "remove"}).status_code == 200
    assert output.is_file()
    assert client.get("/jobs").json() == []


def test_name_is_free_unless_it_was_written(client, session, films):
    """The form offers a name that no file has and no conversion writes, and takes what a user has written as it is."""
    (films / "clip-2x.mp4").touch()
    choices = form(client, films)
    assert choices["name"] == "clip-2x-2.mp4"
    session.queue.add(["fpsboost", "in.mp4", f"{films}/clip-2x-2.mp4"])
    for sent, name in [("clip-2x-2.mp4", "clip-2x-3.mp4"), ("clip-2x.mp4", "clip-2x-3.mp4"), ("shot/", "shot/")]:
        assert check(client, {**choices, "name": sent, "is_named": False})["name"] == name
    replaced = {"name": "clip-2x.mp4", "overwrite": True, "is_named": False}
    assert check(client, {**choices, **replaced})["name"] == "clip-2x.mp4"
    assert "exists already" in notice(client, "/check", {**choices, "name": "clip-2x.mp4", "is_named": True})


@pytest.mark.slow
@pytest.mark.parametrize("name", ["clip-2x.mp4", "frames/"])
def test_result_is_shown_beside_its_source_and_in_its_folder(client, session, films, monkeypatch, name):
    """The source can be played too, and the file manager of this machine shows what was written, a folder as well."""
    started = list[list[str]]()
    number = add(client, form(client, films, name=name))
    until(session.queue, "done")
    monkeypatch.setattr("fpsboost.ui.files.subprocess.Popen", lambda words, **_: started.append(words))
    assert client.get(f"/source/{number}").content == (films / "clip.mp4").read_bytes()
    assert client.post("/change", json={"number": number, "action": "show"}).status_code == 200
    assert str(films) in " ".join(started[0])
    monkeypatch.setattr("fpsboost.ui.files.sys.platform", "darwin")
    client.post("/change", json={"number": number, "action": "show"})
    assert started[1:] == [["open", "-R", str(films / name)]]
    monkeypatch.undo()
    monkeypatch.setenv("PATH", "")
    assert str(films) in notice(client, "/change", {"number": number, "action": "show"})


def test_dropped_files_are_found_by_name_and_size(client, films):
    """In the folder shown, and in those of the folder that the page may use; nothing else, and no path is believed."""
    (films / "holiday").mkdir()
    write_clip(films / "holiday" / "beach.mp4")
    size = (films / "clip.mp4").stat().st_size
    wanted = [("clip.mp4", size), ("beach.mp4", (films / "holiday" / "beach.mp4").stat().st_size)]
    wanted += [("clip.mp4", size + 1), ("../secret.mp4", (films.parent / "secret.mp4").stat().st_size), ("", 0)]
    files = [{"name": name, "size": size} for name, size in wanted]
    found = client.post("/find", json={"folder": str(films), "files": files}).json()
    paths = [str(films / "clip.mp4"), str(films / "holiday" / "beach.mp4")]
    assert found == {"paths": paths, "missing": ["clip.mp4", "secret.mp4", ""]}
    assert "lies outside of" in notice(client, "/find", {"folder": str(films.parent), "files": files})


@pytest.mark.slow
def test_failure_is_said_in_a_sentence(client, session, films):
    """A conversion that fails says why, as on the command line, and can be tried again."""
    choices = form(client, films)
    data = (films / "clip.mp4").read_bytes()
    (films / "clip.mp4").write_bytes(b"damaged meanwhile")
    session.queue.add(["fpsboost", choices["input"], str(films / "out.mp4"), "--method", "nearest"])
    assert str(films / "clip.mp4") in until(session.queue, "failed")["message"]
    (films / "clip.mp4").write_bytes(data)
    session.queue.resume(1)
    until(session.queue, "done")


@pytest.fixture
def waiting_process(monkeypatch):
    """Every first run stops at ten frames; the arguments of all runs."""
    real, runs = jobs.start_process, list[list[str]]()

    def start(words):
        runs.append(words)
        if "--resume" in words:
            return real(words)
        place = hidden_place(Path(words[1]).parent, Path(words[1]).name)
        place.mkdir()
        (place / MANIFEST).write_text("{}")
        (place / "chunk").touch()
        return subprocess.Popen([sys.executable, "-c", STOPPED_AT_TEN], stderr=subprocess.PIPE, encoding="utf-8")

    monkeypatch.setattr(jobs, "start_process", start)
    return runs


def test_cancelling_leaves_nothing(client, session, films, waiting_process):
    """A conversion that is cancelled while it runs, or paused, leaves no unfinished output."""
    before = sorted(os.listdir(films))
    for is_paused_first in (False, True):
        number = add(client, form(client, films))
        until(session.queue, "running", 10)
        assert len(os.listdir(films)) == len(before) + 1
        if is_paused_first:
            session.queue.pause(number)
            assert until(session.queue, "paused")["message"] == "Paused at 10 of 20 frames."
        assert client.post("/change", json={"number": number, "action": "remove"}).status_code == 200
        assert sorted(os.listdir(films)) == before
        assert session.queue.listing() == []


@pytest.mark.usefixtures("waiting_process")
def test_jobs_wait_for_the_one_before(client, session, films):
    """One conversion runs at a time; one that waits is paused and cancelled like the one that runs."""
    for name in ("a.mp4", "b.mp4"):
        add(client, form(client, films, name=name))
    until(session.queue, "running", 10)
    assert [job["state"] for job in session.queue.listing()] == ["running", "waiting"]
    session.queue.pause(2)
    assert [job["state"] for job in session.queue.listing()] == ["running", "paused"]
    session.queue.remove(2)
    assert [job["number"] for job in session.queue.listing()] == [1]
    taken = notice(client, "/add", form(client, films, name="a.mp4"))
    assert taken == f"Another job in the queue writes {films / 'a.mp4'}; choose another name."


def test_clips_are_added_together_or_not_at_all(client, films):
    """If one of several clips cannot be converted, its name is said and none is added; each gets a name of its own."""
    write_clip(films / "clip.mkv")
    first = {**form(client, films), "is_named": False}
    second = {**first, "input": client.post("/pick", json={"path": str(films / "clip.mkv")}).json()["choices"]["input"]}
    wrong, named = {**second, "start": "1", "end": "0"}, {**second, "is_named": True}
    for last, said in [(wrong, "clip.mkv: "), (named, f"Another job in the queue writes {films}/clip-2x.mp4")]:
        assert client.post("/add", json={"clips": [first, last]}).json()["notice"].startswith(said)
    checked = client.post("/check", json={"clips": [first, second]}).json()["clips"]
    assert [each["name"] for each in checked] == ["clip-2x.mp4", "clip-2x-2.mp4"]
    assert client.post("/add", json={"clips": [first, second]}).json() == {"numbers": [1, 2]}


@pytest.mark.usefixtures("waiting_process")
def test_queue_has_a_limit(session, tmp_path):
    """No more jobs than the limit are taken."""
    first, *others = [["fpsboost", "in.mp4", str(tmp_path / f"{number}.mp4")] for number in range(MAX_JOBS + 1)]
    session.queue.add(*others)
    with pytest.raises(OptionError, match="remove some first"):
        session.queue.add(first)


@pytest.mark.parametrize(
    ("frame", "message"),
    [(480, "Paused at 480 of 896 frames."), (0, jobs.BEGINS_ANEW)],
)
def test_pause_says_where_it_goes_on(session, films, monkeypatch, frame, message):
    """A paused conversion says how many frames are kept, or that it begins anew; the next start asks for no others."""
    script = STOPPED_AT_TEN.replace("20", "896").replace('"finished": 10', f'"finished": {frame}')
    process = [sys.executable, "-c", script]
    monkeypatch.setattr(
        jobs, "start_process", lambda words: subprocess.Popen(process, stderr=subprocess.PIPE, encoding="utf-8")
    )
    if frame:
        hidden_place(films, "out.mp4").mkdir()
        (hidden_place(films, "out.mp4") / MANIFEST).write_text("{}")
    session.queue.add(["fpsboost", str(films / "clip.mp4"), str(films / "out.mp4")])
    until(session.queue, "running", 10)
    session.queue.pause(1)
    job = until(session.queue, "paused")
    assert (job["frame"], job["message"]) == (frame, message)
    assert ("--resume" in session.queue.job(1).arguments) == bool(frame)
    session.queue.resume(1)
    until(session.queue, "running")
    session.queue.pause(1)
    assert until(session.queue, "paused")["message"] == message


def test_conversion_of_a_server_that_was_killed(tmp_path):
    """A conversion that was interrupted goes on from what is there, or begins anew."""
    output, place = str(tmp_path / "out.mp4"), hidden_place(tmp_path, "out.mp4")
    job = asdict(jobs.Job(1, ["fpsboost", "in.mp4", output], output, "running"))
    for resumes in (False, True):
        (tmp_path / "queue.json").write_text(json.dumps([job]))
        with closing(Queue(tmp_path / "queue.json")) as queue:
            assert ("--resume" in queue.job(1).arguments) == resumes
            assert ("goes on" in queue.job(1).message, queue.job(1).state) == (resumes, "paused")
        place.mkdir(exist_ok=True)
        (place / MANIFEST).write_text("{}")


@pytest.mark.parametrize(
    ("output", "frame", "resumes"), [("out.gif", 5, False), ("out.mp4", 5, True), ("out.mp4", 0, False)]
)
def test_animation_begins_anew(output, frame, resumes):
    """A kind of output that cannot be resumed is not asked to be."""
    assert ("--resume" in jobs.Job(1, ["fpsboost", "in", output], output, frame=frame).arguments) == resumes


@pytest.mark.parametrize(
    "content", ["{", '{"a": 1}', '[{"number": 1}]', "3", '[{"number": 1, "words": ["a", "b", 3], "output": "c"}]']
)
def test_broken_queue_is_said(tmp_path, content):
    """A file that is no queue is left as it is, and named."""
    (tmp_path / "queue.json").write_text(content)
    with pytest.raises(OutputError, match=r"queue\.json is not a queue"):
        Queue(tmp_path / "queue.json")
    assert (tmp_path / "queue.json").read_text() == content


def test_queue_belongs_to_one_server(tmp_path):
    """A second server of a user is refused while the first one runs."""
    for _ in range(2):
        with closing(Queue(tmp_path / "queue.json")):
            assert {path.name for path in tmp_path.iterdir()} == {"queue.json", "queue.lock"}
            with pytest.raises(OutputError, match="is already running"):
                Queue(tmp_path / "queue.json")


# ---------------------------------------------------------------- the command


@pytest.mark.slow
def test_command_prints_the_address_and_ends(films, fpsboost_, monkeypatch):
    """`fpsboost ui` prints an address that answers, can start on its port at once, and ends within a look.

    Meanwhile another start prints the address and opens the page, by a file, so that no command line has the token.
    """
    monkeypatch.setenv("XDG_STATE_HOME", str(films / "state"))
    page, browser = films / "state" / "fpsboost" / "page.html", list[str]()
    monkeypatch.setattr("webbrowser.open", browser.append)

    def start_again(address):
        assert fpsboost_("ui").out == f"The page, which is running already: {address}\n"
        assert "leave the folder out to open its page" in fpsboost_("ui", str(films)).err
        assert {path.stat().st_mode & 0o077 for path in [page.parent, *page.parent.glob("*.*[!k]")]} == {0}

    run_server(films, run_server(films, "0", start_again), start_again)
    assert browser == [page.as_uri()] * 2


def run_server(films, port, meanwhile):
    """The port of a server that was asked for its page, and stopped while a frame was computed."""
    script = "import threading, fpsboost.__main__, fpsboost.ui.server as server\n"
    script += "server.preview_between = lambda *_: (print('looking', flush=True), threading.Event().wait())\n"
    script += "fpsboost.__main__.main()"
    words = [sys.executable, "-c", script, "ui", str(films), "--no-browser", "--port", port]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as ui:
        address = ui.stdout.readline().removeprefix("The page: ").strip()
        host, port = address.removeprefix("http://").partition("/")[0].split(":")
        assert (host, ui.stdout.readline()[:6]) == ("127.0.0.1", "Ctrl-C")
        meanwhile(address)
        with socket.create_connection((host, int(port))) as asked:
            asked.sendall(f"GET / HTTP/1.0\r\nHost: {host}:{port}\r\n\r\n".encode())
            assert asked.recv(100).startswith(b"HTTP/1.1 200")
            choices = posted_whole(address, "/pick", {"path": str(films / "clip.mp4")})["choices"]
            with posted(address, "/look", {"choices": choices, "time": 0}):
                assert ui.stdout.readline() == "looking\n"
                ui.terminate()
                out, err = ui.communicate(timeout=60)
    assert (out, err, ui.returncode) == ("Stopped.\n", "", 0)
    return port


def test_port_in_use_is_said(fpsboost_, tmp_path, monkeypatch):
    """A port that another program uses, one that is none, and a folder that is none, end with a sentence."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        result = fpsboost_("ui", str(tmp_path), "--port", str(port), "--no-browser")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert f"--port {port} cannot be used (" in result.err
    assert "it must be 0 to 65535" in fpsboost_("ui", str(tmp_path), "--port", "65536", "--no-browser").err
    (tmp_path / "file").touch()
    assert fpsboost_("ui", str(tmp_path / "file")).err.endswith("is not a folder; name one, or leave it out.\n")


def test_missing_packages_are_said(fpsboost_, monkeypatch):
    """Without the packages of the extra, the command says what to install."""
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    result = fpsboost_("ui")
    assert (result.code, "pip install 'fpsboost[ui]'" in result.err) == (2, True)


# ---------------------------------------------------------------- in a browser


@contextmanager
def serving(films, state):
    """A server on a free port while the block lasts; its address."""
    with socket.create_server(("127.0.0.1", 0)) as bound, closing(Queue(state)) as queue:
        port = bound.getsockname()[1]
        app = make_app(UiSession(Files(films), queue, films, TOKEN, port))
        server = uvicorn.Server(uvicorn.Config(app, log_level="error", timeout_graceful_shutdown=1))
        thread = Thread(target=asyncio.run, args=[server.serve(sockets=[bound])])
        thread.start()
        try:
            yield f"http://127.0.0.1:{port}/#{TOKEN}"
        finally:
            server.should_exit = True
            thread.join()


@contextmanager
def opened(chromium, address, **options):
    """The page, which must not complain while the block lasts."""
    page = chromium.new_page(**options)
    page.set_default_timeout(100_000)
    complaints: list[str] = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.goto(address)
    yield page
    page.close()
    # what is wrong with a request is said on the page, and here by the browser as well
    assert [each for each in complaints if not each.startswith("Failed to load resource")] == []


@pytest.mark.parametrize(("width", "height", "scheme"), [(1200, 900, "light"), (390, 844, "dark")])
def test_from_start_to_result(chromium, films, tmp_path, width, height, scheme):
    """A clip is chosen, looked at and converted, and the result plays; nothing is in the way of anybody on the way."""
    (films / "holiday").mkdir()
    with serving(films, tmp_path / "queue.json") as address:
        # axe is a script of its own, which the page would not run
        view = {"width": width, "height": height}
        with opened(chromium, address, viewport=view, color_scheme=scheme, bypass_csp=True) as page:
            page.get_by_role("button", name="holiday").wait_for()
            assert violations(page) == []
            page.get_by_role("button", name="clip.mp4").click()
            page.get_by_text("In the middle between").wait_for()
            page.get_by_text("20 frames, at 50 a second").wait_for()
            page.get_by_text("Details of the file").click()
            page.locator("#facts").get_by_text("constant").wait_for()
            tops = [page.locator(each).bounding_box()["y"] for each in ("#look", "#how")]
            assert width > 900 or tops[0] < tops[1], "on a phone the picture comes before the form"
            page.get_by_label("Speed ramp").check()
            page.get_by_label("Point 2").press("ArrowUp")
            expect(page.get_by_label("Point 2")).to_be_focused()
            expect(page.locator("[name=value]")).to_have_value("0s=0s 0.2s=0.3s 0.6s=0.4s")
            page.locator("[name=value]").fill("smooth 0=0 0.2s=0.1s 0.22s=0.1s 0.24s=.1s")
            page.get_by_label("Point 3").press("ArrowLeft")
            expect(page.locator("[name=value]")).to_have_value("smooth 0s=0s 0.2s=0.1s 0.21s=0.1s 0.24s=0.1s")
            page.locator("[name=value]").fill("1=1 9=5")  # frames as in Nuke, no seconds
            expect(page.get_by_label("Point 2")).to_be_hidden()
            for nonsense in ("soon", ""):
                page.locator("[name=value]").fill(nonsense)
                page.get_by_text("A speed ramp is at least two points").wait_for()
                expect(page.locator("[name=value]")).to_have_value(nonsense)
            page.get_by_label("Twice as many").check()
            page.get_by_label("Mix neighbours").check()
            expect(page.get_by_alt_text("The two frames, mixed")).to_be_visible()
            expect(page.locator("#picture .player")).to_have_count(0)  # without a divider between the same two
            assert page.evaluate("document.documentElement.scrollWidth") == width
            assert violations(page) == []
            page.get_by_role("button", name="Convert").click()
            expect(page.locator("[name=name]")).to_have_value("clip-2x-2.mp4")  # so that another one can begin at once
            expect(page.locator("#jobs .state")).to_have_text("20 of 20 frames")
            after, before = (page.locator(f"#jobs video{each}") for each in ("[poster^='data:']", ":not([controls])"))
            assert (after.evaluate("video => video.muted"), before.evaluate("video => video.muted")) == (False, True)
            after.evaluate("video => (video.currentTime = 0.2)")
            page.wait_for_function("() => document.querySelector('#jobs video').currentTime === 0.2")
            after.evaluate("video => (video.muted = true, video.play())")
            assert violations(page) == []
    assert (films / "clip-2x.mp4").is_file()


def test_token_leaves_the_address_and_an_old_page_goes_on(chromium, films, tmp_path):
    """A page with a wrong token says what to do, and keeps the right one; a new tab lets a page of an old run go on."""
    with serving(films, tmp_path / "queue.json") as address, closing(chromium.new_context()) as context:
        page, bare = context.new_page(), address.partition("#")[0]
        page.goto(f"{bare}#another")
        expect(page.locator("#stranger")).to_contain_text("Run fpsboost ui")
        page.goto(address)
        expect(page.locator("#stranger")).to_be_hidden()
        page.reload()
        page.get_by_role("button", name="clip.mp4").click()
        assert (page.url, TOKEN in page.content()) == (bare, False)
        page.evaluate("localStorage['fpsboost-token'] = token = 'of an earlier start'")
        expect(page.locator("#stranger")).to_be_visible()
        context.new_page().goto(address)
        expect(page.locator("#outcome")).to_contain_text("20 frames, at 50 a second")


def test_page_says_what_is_wrong(chromium, films, tmp_path):
    """A path and a value that are wrong are answered beside them, and the page can go on."""
    with serving(films, tmp_path / "queue.json") as address, opened(chromium, address) as page:
        page.get_by_role("button", name="clip.mp4").wait_for()
        page.locator("#path").fill(str(films / "nothing.mp4"))
        page.locator("#path").press("Enter")
        page.locator("#choose .notice").get_by_text("nothing.mp4").wait_for()
        page.locator("#path").fill(str(films / "clip.mp4"))
        page.locator("#path").press("Enter")
        page.get_by_label("Another frame rate").check()
        page.locator("[name=value]").fill("many")
        page.locator("#form .notice").get_by_text("“Frames a second”").wait_for()
        expect(page.locator("#start")).to_be_disabled()
        page.locator("[name=value]").fill("30")
        page.get_by_text("12 frames, at 30 a second").wait_for()
        assert page.locator("[name=name]").input_value() == "clip-30fps.mp4"
        page.locator("[name=name]").fill("mine.mkv")
        page.get_by_label("Four times").check()
        page.get_by_text("40 frames, at 100 a second").wait_for()
        assert page.locator("[name=name]").input_value() == "mine.mkv"


def test_place_is_typed_until_the_length_is_known(chromium, films, tmp_path):
    """Without a length there is no slider, a place that is typed is shown, and reading brings the slider."""
    write_clip(films / "clip.mkv")
    with serving(films, tmp_path / "queue.json") as address, opened(chromium, address) as page:
        page.get_by_role("button", name="clip.mkv").click()
        page.get_by_text("In the middle between 0:00.000").wait_for()
        assert not page.locator("#time").is_visible()
        page.locator("#at").fill("0:00.2")
        page.locator("#at").press("Enter")
        page.get_by_text("In the middle between 0:00.200").wait_for()
        page.locator("#at").fill("3f")
        page.locator("#at").press("Enter")
        page.get_by_text("In the middle between 0:00.120").wait_for()
        page.get_by_role("button", name="Read the whole clip").click()
        page.locator("#time").wait_for()
        assert float(page.locator("#time").get_attribute("max") or 0) == pytest.approx(0.36)


@pytest.mark.usefixtures("waiting_process")
def test_conversion_goes_on_after_a_restart(chromium, films, tmp_path):
    """A conversion is paused, the server stopped and started again, and the conversion continued to its end."""
    with serving(films, tmp_path / "queue.json") as address, opened(chromium, address) as page:
        page.get_by_role("button", name="clip.mp4").press("Enter")
        expect(page.locator("#clip-title")).to_be_focused()
        page.get_by_label("Repeat frames").check()
        page.locator("#command").get_by_text("nearest").wait_for(state="attached")
        page.get_by_role("button", name="Convert").press("Enter")
        expect(page.locator("#jobs .state")).to_have_text("10 of 20 frames, 5.0 a second, 2 s left")
        expect(page.get_by_role("button", name="Convert")).to_be_focused()
        page.get_by_role("button", name="Pause").press("Enter")
        expect(page.get_by_role("button", name="Continue")).to_be_focused()
        expect(page.locator("#news")).to_have_text("clip-2x.mp4: Paused at 10 of 20 frames.")
        expect(page.locator("#jobs .state")).to_have_text("Paused at 10 of 20 frames.")
    shutil.rmtree(hidden_place(films, "clip-2x.mp4"))  # which was none of a real run
    with serving(films, tmp_path / "queue.json") as address, opened(chromium, address) as page:
        page.get_by_role("button", name="Continue").click()
        expect(page.locator("#jobs .state")).to_have_text("20 of 20 frames")
        page.locator("#jobs video[controls]").wait_for()


def test_streams_of_each_clip_are_chosen(chromium, films, tmp_path):
    """Where a clip has several sounds, each can be left out; without sound, there is nothing to choose."""
    write_sounds(films / "film.mp4")
    with serving(films, tmp_path / "queue.json") as address, opened(chromium, address) as page:
        for name in ("clip.mp4", "film.mp4"):
            page.get_by_label(f"Tick {name}").check()
        page.get_by_role("button", name="Use these 2 clips").click()
        expect(page.locator("#clip-title")).to_have_text("2 clips")
        expect(page.locator("#streams")).to_be_hidden()
        page.get_by_role("radio", name="film.mp4").click()
        streams = page.get_by_role("group", name="Streams to keep of film.mp4")
        streams.get_by_label("1: audio: aac").uncheck()
        expect(page.locator("#command")).to_have_text(re.compile(r"film-2x.mp4 --factor 2 --streams 2$"))
        page.get_by_role("radio", name="film.mp4").press("ArrowRight")
        expect(page.get_by_role("radio", name="clip.mp4")).to_be_focused()
        page.get_by_role("radio", name="clip.mp4").press("ArrowLeft")
        streams.get_by_label("2: audio: aac").uncheck()
        expect(page.locator("#command")).to_have_text(re.compile(r"film-2x.mp4 --factor 2 --no-audio$"))
        page.get_by_label("Keep the sound").uncheck()
        expect(streams.get_by_label("2: audio: aac")).to_be_disabled()


@pytest.mark.parametrize("way", ["tick", "drop"])
def test_several_clips_become_something_alike(chromium, films, tmp_path, way):
    """Clips that are ticked or dropped are looked at one by one and converted by one form, each beside its source."""
    (films / "holiday").mkdir()
    write_clip(films / "holiday" / "beach.mp4")
    write_clip(films / "holiday" / "city.mp4")
    with serving(films, tmp_path / "queue.json") as address, opened(chromium, address) as page:
        page.get_by_role("button", name="holiday").press("Enter")
        expect(page.get_by_role("button", name="beach.mp4")).to_be_focused()
        if way == "tick":
            for name in ("beach.mp4", "city.mp4"):
                page.get_by_label(f"Tick {name}").check()
            page.get_by_role("button", name="Use these 2 clips").click()
        else:
            sizes = [(each.name, each.stat().st_size) for each in sorted((films / "holiday").iterdir())]
            page.evaluate(
                """files => {
                    const dataTransfer = new DataTransfer();
                    for (const [name, size] of files) dataTransfer.items.add(new File([new Uint8Array(size)], name));
                    for (const kind of ["dragover", "drop"]) {
                        dispatchEvent(new DragEvent(kind, { dataTransfer, bubbles: true, cancelable: true }));
                    }
                }""",
                sizes,
            )
        expect(page.locator("#clip-title")).to_have_text("2 clips")
        expect(page.locator("#clip-title")).to_be_focused()
        for name in ("city.mp4", "beach.mp4", "city.mp4", "city.mp4"):
            page.get_by_role("radio", name=name).click()  # which drops what is read
        page.locator("#facts").get_by_text("constant").wait_for(state="attached")
        expect(page.locator("#clip .notice")).to_be_hidden()
        if way == "drop":  # from here on, nothing tells how they came
            return
        page.get_by_label("Repeat frames").check()
        page.get_by_label("Another multiple").check()
        page.locator("#names").get_by_text("beach-3x.mp4, city-3x.mp4").wait_for()
        page.get_by_text("beach.mp4: 30 frames, at 75 a second").wait_for()
        page.get_by_role("button", name="Convert").click()
        expect(page.locator("#jobs .state")).to_have_text(["30 of 30 frames"] * 2)
        page.get_by_role("button", name="Remove beach-3x.mp4").press("Enter")
        expect(page.get_by_role("heading", name="city-3x.mp4")).to_be_focused()
        page.get_by_role("button", name="Other clips").press("Enter")
        expect(page.get_by_role("button", name="beach.mp4")).to_be_focused()
    assert {each.name for each in (films / "holiday").iterdir()} >= {"beach-3x.mp4", "city-3x.mp4"}
