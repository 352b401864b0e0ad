"""Remarks: what they say after a run and before it, as text and as data."""

import copy
import pickle
import re

import pytest

from fpsboost.media import Remark
from fpsboost.media.remarks import WOULD
from fpsboost.remarks import Remarks


@pytest.fixture
def lost():
    """A remark on a stream that a file lacks."""
    remarks = Remarks()
    remarks.add("stream-not-held", name="out.mp4", lost_stream=3, what="stream 3 (data, klv)", way="write .mov")
    return remarks[0]


def test_a_remark_is_a_sentence(lost):
    """It is its sentence, and says of what kind it is, and its values."""
    assert lost == "out.mp4 does not hold stream 3 (data, klv) of its source; write .mov."
    assert (lost.kind, lost.values["lost_stream"], lost.values["name"]) == ("stream-not-held", 3, "out.mp4")


def test_what_is_expected_is_no_fact(lost):
    """Before the run it is said what would happen; kind and values stay."""
    assert lost.expected == "out.mp4 would not hold stream 3 (data, klv) of its source; write .mov."
    assert (lost.expected.kind, lost.expected.values["lost_stream"]) == ("stream-not-held", 3)


@pytest.mark.parametrize(
    ("kind", "values", "expected"),
    [
        ("rate-assumed", {"name": "-", "rate": 25, "advice": ""}, "25 frames per second would be assumed."),
        ("alpha-over-white", {"name": "in.gif"}, "they would be laid over white."),
        ("lines-lost", {"name": "out.mp4", "stream": 3}, "out.mp4 would lose lines of stream 3 of its source"),
        ("frames-moved-later", {"name": "a", "count": "2 frames"}, "would be put into the gap that follows."),
        ("picture-held", {"name": "a", "longest": 4, "begin": 1, "as_one": "", "limit": 2}, "would be held there"),
    ],
)
def test_any_sentence_can_be_expected(kind, values, expected):
    """Whatever its verb is."""
    remarks = Remarks()
    remarks.add(kind, **values)
    assert expected in remarks.expected[0]


def test_copies_say_the_same(lost):
    """Copied or sent to another process, also of what is expected."""
    for remark in (lost, lost.expected):
        for again in (copy.deepcopy(remark), pickle.loads(pickle.dumps(remark))):
            assert (again, again.kind, again.values, again.expected) == (
                remark,
                remark.kind,
                remark.values,
                remark.expected,
            )


def test_each_is_said_once(lost):
    """Plain sentences of others are remarks too, and stay as they are before a run."""
    remarks = Remarks([lost, "A cow passed.", lost])
    remarks.take(["A cow passed.", "It rained."])
    assert [remark.kind for remark in remarks] == ["stream-not-held", "other", "other"]
    assert remarks.expected[1:] == ["A cow passed.", "It rained."]


def test_names_can_be_others(lost):
    """A file that has another name for a while is called by its final one."""
    assert lost.about("out.mp4", "film.mp4").startswith("film.mp4 does not hold")
    assert lost.about("out", "film") == lost


def test_values_may_hold_braces():
    """Names of files are not templates."""
    remark = Remark("other", "{name} {was} read.", {"name": "{was}.mp4"})
    assert (remark, remark.expected) == ("{was}.mp4 was read.", "{was}.mp4 would be read.")


FACTS = {
    "no-frames-missing",  # what was read before
    "passages-looked-at",
    "not-encrypted",  # this is said when all is done
    "no-motion",
    "clock-jumps",  # recordings were joined
}
"""Kinds whose verbs are true before the run, too."""


def test_verbs_are_marked():
    """In every sentence the verbs of what the run did are marked, so that it can also be said before."""
    verbs = re.compile(r"(?<![{\w])(?<!} )(was|were|lost|wrote|kept|held)(?![}\w])")
    unmarked = {kind for kind, text in Remarks.texts.items() if verbs.search(text)} - FACTS
    assert unmarked == set()
    assert {verb for text in Remarks.texts.values() for verb in WOULD if f"{{{verb}}}" in text} == WOULD.keys()
