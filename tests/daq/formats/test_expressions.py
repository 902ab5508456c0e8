"""Signals made of others: the language, its refusals, and its way from registers to a
standstill."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.daq.formats.expressions import DEEPEST, MOST_CHARACTERS, Memory, parse_expression
from stepdiag.daq.formats.signals import SignalDecoder, plan_reads
from stepdiag.daq.records.events import ModbusBlock, ReadRange
from stepdiag.daq.survey.file import parse_survey
from testkit.timeline import survey_text

KINDS = {"a": "bit", "b": "bit", "n": "word", "m": "word"}


def value(text, memory=None, **inputs):
    found = parse_expression(text, KINDS, "plc.expressions.stopped")
    return found.value({"a": 0, "b": 0, "n": 0.0, "m": 0.0} | inputs, memory or Memory())


def spoken(depth=3):
    """Return yes-or-no expressions whose words are those of Python, which then says what they are
    worth."""
    number = st.sampled_from(["n", "m", "0", "1", "2.5", "-3"])
    leaf = st.sampled_from(["a", "b"]) | st.tuples(
        number, st.sampled_from(["==", "!=", "<", "<=", ">", ">="]), number
    ).map(" ".join)
    return st.recursive(
        leaf,
        lambda inner: (
            inner.map("not ({})".format)
            | st.tuples(inner, inner).map(lambda two: f"({two[0]}) and {two[1]}")
            | st.tuples(inner, inner).map(lambda two: f"{two[0]} or ({two[1]})")
        ),
        max_leaves=6,
    )


@given(spoken(), st.booleans(), st.booleans(), st.integers(-3, 3), st.integers(-3, 3))
def test_what_is_known_is_worth_what_it_says(text, a, b, n, m):
    expected = bool(eval(text, {"__builtins__": {}}, {"a": a, "b": b, "n": n, "m": m}))
    assert value(text, a=a, b=b, n=n, m=m) is expected


@pytest.mark.parametrize(
    ("text", "inputs", "expected"),
    [
        ("a and b", {"a": None, "b": 0}, False),
        ("a and b", {"a": None, "b": 1}, None),
        ("a or b", {"a": 1, "b": None}, True),
        ("a or b", {"a": 0, "b": None}, None),
        ("not a", {"a": None}, None),
        ("n > 1", {"n": None}, None),
    ],
)
def test_what_was_not_read_is_unknown_unless_it_does_not_matter(text, inputs, expected):
    assert value(text, **inputs) is expected


def test_a_latch_keeps_the_last_number_that_was_not_zero():
    memory = Memory()
    assert [value("latch(n) == 7", memory, n=n) for n in (0, 7, 0, 0, 8, 0)] == [
        False,
        True,
        True,
        True,
        False,
        False,
    ]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a and", "the end of 'a and'"),
        ("a and und b", "'und' at character 7"),
        ("a b", "'b' at character 3"),
        ("a = b", "'=' at character 3"),
        ("n and a", "expected yes or no .*'n' at character 1"),
        ("a > 1", "expected a number .*'a' at character 1"),
        ("n > a", "'a' at character 5"),
        ("latch(a)", "'a' at character 7"),
        ("(a", "expected \\), found the end"),
        ("n < 3 < 4", "'<' at character 7"),
        ("__import__('os')", "'__import__' at character 1"),
        ("", "the end of ''"),
        ("(" * (DEEPEST + 1) + "a" + ")" * (DEEPEST + 1), "levels of brackets"),
        ("a or " * MOST_CHARACTERS + "a", f"at most {MOST_CHARACTERS} characters"),
    ],
)
def test_a_refusal_points_at_the_character(text, said):
    with pytest.raises(UsageError, match=said):
        parse_expression(text, KINDS, "plc.expressions.stopped")


@given(st.text(alphabet="abnm andornt()<>=!-0.5latch\"'\\", max_size=60))
def test_whatever_is_written_is_an_expression_or_a_refusal(text):
    with suppress(UsageError):
        parse_expression(text, KINDS, "x")


SIGNALS = """
[plc.inputs.mark]
address = 40
[plc.inputs.exact_x]
address = 50
type = "bit"
bit = 3
[plc.expressions]
stopped = "mark > 0 and exact_x"
stop_count = "latch(mark)"
"""


def test_a_machine_without_a_stopped_bit_is_read_and_understood():
    plc = parse_survey(survey_text(signals=SIGNALS), "survey.toml").plc
    assert plc.signal_names == ("stopped", "stop_count")
    reads = plan_reads(plc.signals, plc.standing)
    assert reads == (
        ReadRange("holding", 40, 1),
        ReadRange("holding", 50, 1),
        ReadRange("holding", 40, 1),
        ReadRange("holding", 50, 1),
    )
    decoder = SignalDecoder(plc.signals, plc.parsed())

    def polled(*words):
        found = decoder.decode(
            ModbusBlock(0, 1, reads, tuple(word.to_bytes(2, "big") for word in words))
        )
        return found.stopped, found.stop_count

    assert polled(0, 0, 0, 0) == (False, 0)
    assert polled(5, 8, 5, 8) == (True, 5)
    assert polled(5, 8, 0, 0) == (False, 5)  # it left between the two
    assert polled(0, 8, 0, 8) == (False, 5)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"mark > 0 and exact_x"', '"mark"', "plc.expressions.stopped: expected yes or no"),
        ('"latch(mark)"', '"mark > 2"', "plc.expressions.stop_count: expected a number"),
        ("stop_count =", "x_mm =", "plc.expressions"),
        (
            "[plc.inputs.mark]",
            "[plc.inputs.stopped]",
            "plc.inputs.stopped: expected a name that is no signal's",
        ),
        (
            'stopped = "mark > 0 and exact_x"\n',
            "",
            "plc.signals: expected at least the signal stopped",
        ),
        ("bit = 3", "bit = 16", "plc.inputs.exact_x.bit"),
    ],
)
def test_a_survey_that_cannot_be_meant_is_refused_by_field(old, new, said):
    with pytest.raises(UsageError, match=said):
        parse_survey(survey_text(signals=SIGNALS.replace(old, new)), "survey.toml")
