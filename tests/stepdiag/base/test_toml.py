"""A TOML text that would cost the reader the square of its size is refused before it is read."""

import time
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base.errors import UsageError
from stepdiag.base.settings import _DEEPEST, read_toml

QUIET = (
    'b = "x.y.z.u.v.w.x"',
    "c = 'p.q.r.s.t.u.v\"'",
    '"\\"quoted\\"" = "a \\\\ \\" b"',
    "d = 2026-05-31",
    "f.g.'h'.\"i\" . j = true",
    'k = """ one " two "" three\nx.y.z.u.v.w.x = 1\n\\""""""',
    "l = '''it's ''two''\nx.y.z.u.v.w.x = 1'''",
    "m = [1.0, 2.5,\n  3]",
    '# don\'t say "that" : x.y.z.u.v.w.x',
    'n = "" # """',
    "[o.p.q.r.s]",
)
quiet = st.lists(st.sampled_from(QUIET), unique=True).map("\n".join)
part = st.sampled_from(["x", "1-a_", "'u.v'", '"z\\".\\\\"', '""', "'\"'"])
joint = st.sampled_from([".", " . ", "\t."])
begun = st.sampled_from(
    ["{} = 1", "[ {} ]", "[[{}]]", "in = {{ {} = 1}}", 'q = ["""e"""", {{{}=1}}]']
)


@given(quiet)
def test_a_text_of_short_names_is_read(text):
    assert read_toml(text, "x") == tomllib.loads(text)


@given(quiet, begun, st.lists(part, min_size=1, max_size=_DEEPEST + 9), joint, quiet)
def test_a_name_of_too_many_parts_is_refused_with_its_line(
    before, begun, parts, joint, after
):
    """In every place where a name may stand, and however its parts are written."""
    name = joint.join(parts)
    text = "\n".join([before, "[t]", begun.format(name), after])
    if len(parts) <= _DEEPEST:
        try:
            expected = tomllib.loads(text)
        except tomllib.TOMLDecodeError:  # such as two parts of one name
            return
        assert read_toml(text, "x") == expected
        return
    with pytest.raises(UsageError, match=rf"x: line {before.count(chr(10)) + 3}: "):
        read_toml(text, "x")


@pytest.mark.parametrize(
    "text",
    [
        "a." * 200_000 + "a = 1",
        'a = "' + '\\"' * 200_000,
        'a = """' + '\\"""' * 100_000,
        "a = '''" + "''" * 200_000,
        "a" * 400_000,
        "a = " + "[" * 400_000,
        '"' * 400_000,
        "a . " * 19 + "'" + "b" * 400_000,
        ".a" * 19 + " " * 400_000,
        ("a." * 19 + "a" * 60 + "\n") * 4_000,
        '\\"a' * 130_000,
    ],
)
def test_a_hostile_text_costs_its_size_and_not_the_square(text):
    """400 kB each; the reader's own work on such a text is not counted here."""
    begun = time.process_time()
    with pytest.raises(UsageError):
        read_toml(text, "x")
    assert time.process_time() - begun < 4.0
