"""Signals made of others: the language, its refusals, and its way from registers to a
standstill."""

import keyword
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.daq.formats.expressions import (
    DEEPEST,
    MOST_CHARACTERS,
    Memory,
    parse_expression,
)
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
        ("not " * (DEEPEST + 1) + "a", "levels of brackets"),
        ("not (" * (DEEPEST // 2) + "not a" + ")" * (DEEPEST // 2), "levels of brackets"),
        ("a or " * MOST_CHARACTERS + "a", f"at most {MOST_CHARACTERS} characters"),
    ],
)
def test_a_refusal_points_at_the_character(text, said):
    with pytest.raises(UsageError, match=said):
        parse_expression(text, KINDS, "plc.expressions.stopped")


class Read(dict):
    """Inputs that keep which of them were asked for."""

    def __init__(self, **values):
        super().__init__(values)
        self.asked = set()

    def __getitem__(self, name):
        self.asked.add(name)
        return super().__getitem__(name)


PIECES = (
    *(
        "a",
        "b",
        "n",
        "m",
        "x",
        "in",
        "None",
        "latch",
        "latch(n)",
        "and",
        "or",
        "not",
        "(",
        ")",
    ),
    *(
        "==",
        "!=",
        "<",
        "<=",
        ">=",
        "-",
        "0",
        "07",
        "2.5",
        "1e5",
        "1j",
        "(n)",
        "=",
        ":=",
        "é",
        "\n",
    ),
    *(
        "__import__",
        "eval",
        "lambda",
        "if",
        "else",
        "for",
        "await",
        "is",
        ".",
        "[0]",
        ",",
        "'a'",
    ),
    *(
        "n.real",
        "a()",
        "{n}",
        "*",
        "**",
        "%",
        "@",
        "f'{n}'",
        "#",
        "\\",
        "yield",
        ";",
        "print",
    ),
)
written = st.text(alphabet="abnm andornt()<>=!-0.5latch\"'\\", max_size=60) | st.lists(
    st.sampled_from(PIECES), max_size=9
).map(" ".join)


@given(written)
@settings(max_examples=400)
def test_whatever_is_written_reads_the_inputs_or_is_refused(text):
    """No expression reaches anything but the names that it may read, and Python evaluates none."""
    with suppress(UsageError):
        found = parse_expression(text, KINDS, "x")
        inputs = Read(a=1, b=0, n=2.0, m=None)
        assert isinstance(found.value(inputs, Memory()), bool | float | None)
        assert inputs.asked <= found.names <= KINDS.keys()


@given(st.text(max_size=30), st.sampled_from(["n", "latch(n)"]))
def test_a_name_that_is_no_input_is_refused_before_python_reads_it(name, good):
    """Whatever Python would take as a name, a call or a statement."""
    if name.strip() in {"", *KINDS, "latch"} or not name.isidentifier():
        name = f"os.{name}"
    with pytest.raises(UsageError, match=r"plc\.expressions\.stopped"):
        parse_expression(f"{good} > 1 and {name}", KINDS, "plc.expressions.stopped")
    with pytest.raises(UsageError, match=r"plc\.expressions\.stopped"):
        parse_expression(f"{name} > {good}", KINDS, "plc.expressions.stopped")


@pytest.mark.parametrize("name", [*keyword.kwlist, *keyword.softkwlist])
def test_an_input_may_have_the_name_of_a_keyword_of_python(name):
    """The words of the language itself are no names."""
    read = {name: "word"}
    if name in ("and", "or", "not"):
        with pytest.raises(UsageError):
            parse_expression(f"{name} > 1", read, "x")
        return
    found = parse_expression(f" {name} >= 007 and latch({name}) == 7.0", read, "x")
    assert found.names == {name}
    assert [found.value({name: one}, Memory()) for one in (7, 6, None)] == [True, False, None]


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
            "plc.inputs.stopped: expected a name that no signal has",
        ),
        (
            'stopped = "mark > 0 and exact_x"\n',
            "",
            "plc.signals: expected at least the signal `stopped`",
        ),
        ("bit = 3", "bit = 16", "plc.inputs.exact_x.bit"),
    ],
)
def test_a_survey_that_cannot_be_meant_is_refused_by_field(old, new, said):
    with pytest.raises(UsageError, match=said):
        parse_survey(survey_text(signals=SIGNALS.replace(old, new)), "survey.toml")
