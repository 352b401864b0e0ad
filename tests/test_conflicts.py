"""Options that cannot be combined, and those that need another."""

import re
from inspect import signature
from itertools import chain, product

import pytest

from fpsboost import interpolate_clip
from fpsboost.cli.options import option_classes
from fpsboost.conflicts import CONFLICTS, NEEDS, USES, check_together
from fpsboost.errors import OptionError
from fpsboost.options import flags_of

PAIRS = [(pair, each.advice) for each in CONFLICTS for pair in product(each.options, each.others)]

VAPOURSYNTH = {"fps_num", "fps_den", "factor_num", "factor_den"}
"""Parameters of the filter."""


@pytest.mark.parametrize(("pair", "advice"), PAIRS, ids=lambda each: " ".join(each) if isinstance(each, tuple) else "")
def test_pairs_are_refused(pair, advice):
    """In one sentence that names both and says what to do."""
    with pytest.raises(OptionError) as refused:
        check_together({*pair, *chain.from_iterable(NEEDS[name] for name in pair if name in NEEDS)})
    text = str(refused.value)
    assert re.fullmatch(rf"`.* and .* cannot be combined: .*; {advice}\.", text)
    assert all(name.strip("`") in text for name in pair)


def test_a_pair_has_one_reason():
    """No two rows name the same options."""
    pairs = [frozenset(pair) for pair, _ in PAIRS]
    assert len(pairs) == len(set(pairs))


@pytest.mark.parametrize(("option", "others"), NEEDS.items())
def test_options_that_need_another(option, others):
    """Refused alone, with advice for one or for a choice, and taken with any that they need."""
    needed = " or ".join(f"`{other}`" for other in others)
    advice = "give one of them" if len(others) > 1 else "give that too"
    with pytest.raises(OptionError, match=f"^`{option}` needs {needed}; {advice}, or leave it out\\.$"):
        check_together({option})
    for other in others:
        check_together({option, other})


def test_all_names_are_options():
    """Fields of options, parameters, or one of the uses that have no option, all of which are named."""
    fields = {flag.field for cls in option_classes for flag in flags_of(cls)}
    named = chain.from_iterable((*each.options, *each.others, *filter(None, [each.unless])) for each in CONFLICTS)
    names = {name.partition("=")[0] for name in (*named, *NEEDS, *chain.from_iterable(NEEDS.values()))}
    assert names <= {*fields, *USES, *VAPOURSYNTH, *signature(interpolate_clip).parameters}
    assert {*USES} <= names
