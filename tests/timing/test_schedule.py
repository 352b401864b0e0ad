"""Which output frame lies where: exact, in order, complete."""

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpsboost.errors import OptionError
from fpsboost.timing.schedule import MAX_TICKS_PER_SECOND, ByFactor, ByRate, Schedule, Step, parse_number, parse_rate

factors = st.fractions(Fraction(1, 8), 12, max_denominator=9)
rates = st.sampled_from([24, 25, 30, 50, 60, 120, 144]).map(Fraction) | st.sampled_from([24, 30, 60, 120]).map(
    lambda rate: Fraction(rate * 1000, 1001)
)
intervals = st.lists(st.fractions(Fraction(1, 1000), 2, max_denominator=1001), min_size=1, max_size=8)
starts = st.fractions(-3, 3, max_denominator=1001)


def times_from(start: Fraction, gaps: Sequence[Fraction]) -> list[Fraction]:
    """Source times."""
    times = [start]
    for gap in gaps:
        times.append(times[-1] + gap)
    return times


def all_steps(schedule: Schedule, times: Sequence[Fraction]) -> list[tuple[int, Step]]:
    """Every output frame with the number of its pair."""
    pairs = enumerate(pairwise(times))
    return [(k, step) for k, (time0, time1) in pairs for step in schedule.steps(k, times[0], time0, time1)]


@pytest.mark.slow
@given(st.one_of(factors.map(ByFactor), rates.map(ByRate)), starts, intervals)
def test_output_times_strictly_increase_within_their_pairs(schedule, start, gaps):
    """Every frame lies in the half-open interval of its pair, at the place that t says, after the one before."""
    times = times_from(start, gaps)
    steps = all_steps(schedule, times)
    for k, step in steps:
        assert 0 <= step.t < 1
        assert step.time == times[k] + step.t * (times[k + 1] - times[k])
    shown = [step.time for _, step in steps]
    assert all(earlier < later for earlier, later in pairwise(shown))
    assert shown[:1] == [start]


@pytest.mark.slow
@given(factors, starts, intervals)
def test_a_factor_multiplies_the_count_exactly(factor, start, gaps):
    """n intervals give the multiples of 1 / factor below n, no more and no fewer."""
    steps = all_steps(ByFactor(factor), times_from(start, gaps))
    positions = [k + step.t for k, step in steps]
    expected = []
    while len(expected) / factor < len(gaps):
        expected.append(len(expected) / factor)
    assert positions == expected


@pytest.mark.slow
@given(st.integers(1, 12), starts, intervals)
def test_source_frames_keep_their_exact_times_under_whole_factors(factor, start, gaps):
    """Variable intervals or not: every source time is there, and each interval is cut evenly."""
    times = times_from(start, gaps)
    steps = all_steps(ByFactor(Fraction(factor)), times)
    assert [step.time for _, step in steps if step.t == 0] == times[:-1]
    for k, (time0, gap) in enumerate(zip(times, gaps, strict=False)):
        assert [step.time for pair, step in steps if pair == k] == [time0 + gap * j / factor for j in range(factor)]


@pytest.mark.parametrize("kind", [ByFactor, ByRate])
def test_a_pause_is_held(kind):
    """Between two frames that are further apart than a schedule says, the first is repeated, from its time on."""
    schedule = kind(Fraction(5, 2), longest=Fraction(1))
    times = [Fraction(0), Fraction(2, 5), Fraction(7, 5), Fraction(22, 5)]
    shown = [[step for pair, step in all_steps(schedule, times) if pair == k] for k in range(3)]
    assert any(step.t for step in [*shown[0], *shown[1]])
    assert len(shown[2]) > 1
    assert {step.t for step in shown[2]} == {0}
    assert shown[2][0].time - times[2] < (Fraction(1, 9999) if kind is ByFactor else Fraction(2, 5))


@pytest.mark.slow
@given(rates, starts, intervals)
def test_a_rate_hits_every_tick_of_its_own_clock(rate, start, gaps):
    """Against brute force: all start + k / rate before the last source frame, each in the one pair that holds it."""
    times = times_from(start, gaps)
    expected = []
    for k in range(10**6):
        time = start + k / rate
        if time >= times[-1]:
            break
        pair = max(index for index, frame_time in enumerate(times) if frame_time <= time)
        expected.append((pair, time, (time - times[pair]) / (times[pair + 1] - times[pair])))
    assert [(k, step.time, step.t) for k, step in all_steps(ByRate(rate), times)] == expected


@given(factors, st.sampled_from([24, 25, 600, 1000, 12800, 24000, 30000]), st.lists(st.integers(1, 90), max_size=6))
def test_the_time_base_holds_every_time_of_a_factor(factor, ticks, gaps):
    """Where 32 bits suffice, every output time is a whole number of ticks."""
    base = Fraction(1, ticks)
    times = times_from(Fraction(7, ticks), [gap * base for gap in [1, *gaps]])
    out = ByFactor(factor).time_base(base)
    assert out.numerator == 1
    assert out.denominator <= MAX_TICKS_PER_SECOND
    assert all((step.time / out).denominator == 1 for _, step in all_steps(ByFactor(factor), times))


@given(rates, st.sampled_from([24, 25, 600, 1000, 12800, 24000, 30000]), st.integers(-100, 100))
def test_the_time_base_holds_every_time_of_a_rate(rate, ticks, start):
    """Ticks of the source's clock, where the first frame lies, and of the output's rate are both whole."""
    out = ByRate(rate).time_base(Fraction(1, ticks))
    assert out.denominator <= MAX_TICKS_PER_SECOND
    assert all(((Fraction(start, ticks) + k / rate) / out).denominator == 1 for k in range(5))


@pytest.mark.parametrize(
    ("text", "rate"),
    [
        ("60", Fraction(60)),
        (" 25 ", Fraction(25)),
        ("24.0", Fraction(24)),
        ("23.976", Fraction(24000, 1001)),
        ("23.98", Fraction(24000, 1001)),
        ("29.97", Fraction(30000, 1001)),
        ("47.952", Fraction(48000, 1001)),
        ("59.94", Fraction(60000, 1001)),
        ("119.88", Fraction(120000, 1001)),
        ("12.5", Fraction(25, 2)),
        ("60000/1001", Fraction(60000, 1001)),
        ("2997/100", Fraction(2997, 100)),
        ("0.5", Fraction(1, 2)),
    ],
)
def test_rates_are_read_as_people_write_them(text, rate):
    """The usual abbreviations mean n x 1000/1001; everything else means itself."""
    assert parse_rate(text) == rate


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("2", 2),
        ("2.5", Fraction(5, 2)),
        ("-1", -1),
        ("0.1", Fraction(1, 10)),
        ("1e3", 1000),
        ("25E-2", Fraction(1, 4)),
        ("1_000.", 1000),
        ("+.5", Fraction(1, 2)),
    ],
)
def test_numbers_are_read_exactly(text, number):
    """No float in between."""
    assert parse_number(text, "factor") == number


@pytest.mark.parametrize(
    "text", ["", "abc", "1/0", "2,5", "nan", "inf", "1/2/3", "0x10", "2x", "--2", "1e999", "1e-5000"]
)
def test_what_is_no_number_is_refused(text):
    """The message says what the number was for and repeats it."""
    with pytest.raises(OptionError, match="frame rate"):
        parse_rate(text)


@given(factors, st.integers(0, 50))
def test_source_frames_know_their_place_among_output_frames(factor, index):
    """Output frame k lies at place k, whichever way the rate is given."""
    time = Fraction(index, 24)
    for schedule in (ByFactor(factor), ByRate(24 * factor)):
        place = schedule.output_position(index, Fraction(0), time)
        steps = schedule.steps(index, Fraction(0), time, time + Fraction(1, 24))
        assert [place + step.t * factor for step in steps] == list(range(math.ceil(place), math.ceil(place + factor)))
