"""Names of too many parts are seen wherever a TOML text has one, and nowhere else."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.base import dotted_names
from stepdiag.base.dotted_names import longer_than

MOST = 5
QUIET = (
    "a = 1",
    'b = "x.y.z.u.v.w.x"',
    "c = 'p.q.r.s.t.u.v\"'",
    '"\\"quoted\\"" = "a \\\\ \\" b"',
    "d = 2026-05-31",
    "e = 1.5",
    "f.g.'h'.\"i\" . j = true",
    'k = """ one " two "" three\nx.y.z.u.v.w.x = 1\n\\""""""',
    "l = '''it's ''two''\nx.y.z.u.v.w.x = 1'''",
    "m = [1.0, 2.5,\n  3]",
    '# don\'t say "that" : x.y.z.u.v.w.x',
    'n = "" # """',
    "[o.p.q.r.s]",
)
"""Statements without a name of more than five parts; put together in any order they may repeat a
name, which is not what is asked here."""
DEEP = (
    "x.y.z.u.v.w = 1",
    "[ x . \"y\" . z.'u'\t.v.w ]",
    'in = {x.y."z\\".".u.v.w = 1}',
    'q = ["""e"""", {x.y.z.u.v.w = 1}]',
)


@given(st.lists(st.sampled_from(QUIET)))
def test_a_text_without_one_is_passed(lines):
    assert longer_than(MOST, "\n".join(lines)) is None


@given(st.lists(st.sampled_from(QUIET)), st.sampled_from(DEEP), st.lists(st.sampled_from(QUIET)))
def test_one_is_found_with_its_line(before, deep, after):
    found = longer_than(MOST, "\n".join([*before, deep, *after]))
    assert found is not None
    assert found.line == sum(each.count("\n") + 1 for each in before) + 1
    assert found.text in deep
    assert found.text.startswith("x")


@pytest.mark.parametrize("text", [*QUIET, *DEEP])
def test_these_are_toml(text):
    tomllib.loads(text)


@given(st.text(alphabet="\"'\\#.a- \t\n=[é"))
def test_every_character_is_looked_at_once(text):
    tokens = [token.group() for token in dotted_names._TOKEN.finditer(text)]
    assert "".join(tokens) == text
    assert all(tokens)


def test_what_could_be_the_beginning_of_many_texts_takes_no_longer():
    """Each escaped quote was looked at as the beginning of a text up to the end: 400 kB of them
    would have taken eight minutes."""
    assert longer_than(MOST, 'a = "' + '\\"' * 200_000) is None
    assert longer_than(MOST, 'a = """' + '\\"""' * 100_000) is None
    assert longer_than(MOST, "a = '''" + "''" * 200_000) is None
