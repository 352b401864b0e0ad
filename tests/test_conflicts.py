"""Options that cannot be combined, and those that need another."""

import re
from inspect import signature
from itertools import chain, product

import pytest

from fpsboost import interpolate_clip
from fpsboost.cli.options import option_classes
from fpsboost.conflicts import CONFLICTS, NEEDS, check_together, names_in
from fpsboost.errors import OptionError
from fpsboost.options import flags_of

PAIRS = [(pair, each.advice) for each in CONFLICTS for pair in product(names_in(each.options), names_in(each.others))]

USES = {"a preview", "a dry run", "several inputs", "`retime` that plays backwards", "`cuts` by frames"}
USES |= {"`mask` by frames"}

VAPOURSYNTH = {"fps_num", "fps_den", "factor_num", "factor_den"}
"""Parameters of the filter."""


@pytest.mark.parametrize(("pair", "advice"), PAIRS, ids=lambda each: " ".join(each) if isinstance(each, tuple) else "")
def test_pairs_are_refused(pair, advice):
    """In one sentence that names both and says what to do."""
    with pytest.raises(OptionError) as refused:
        check_together({*pair, *chain.from_iterable(names_in(NEEDS[name]) for name in pair if name in NEEDS)})
    text = str(refused.value)
    assert re.fullmatch(rf"`.* and .* cannot be combined: .*; {advice}\.", text)
    assert all(name.strip("`") in text for name in pair)


def test_a_pair_has_one_reason():
    """No two rows name the same options."""
    pairs = [frozenset(pair) for pair, _ in PAIRS]
    assert len(pairs) == len(set(pairs))


@pytest.mark.parametrize(("option", "others"), NEEDS.items())
def test_options_that_need_another(option, others):
    """Refused alone, and taken with any that they need."""
    with pytest.raises(OptionError, match=f"`{option}` needs `{names_in(others)[0]}`"):
        check_together({option})
    for other in names_in(others):
        check_together({option, other})


def test_all_names_are_options():
    """Fields of options, parameters, or one of the uses that have no option."""
    fields = {flag.field for cls in option_classes for flag in flags_of(cls)}
    entries = [*chain.from_iterable((each.options, each.others, each.unless) for each in CONFLICTS)]
    entries += chain.from_iterable(NEEDS.items())
    names = {name.partition("=")[0] for name in chain.from_iterable(map(names_in, filter(None, entries)))}
    assert names <= fields | USES | VAPOURSYNTH | signature(interpolate_clip).parameters.keys()
