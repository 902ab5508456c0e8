"""How a foreign file differs from a good one: bytes and lines changed, numbers replaced by those
that break readers."""

import re

from hypothesis import strategies as st

NUMBERS = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
HOSTILE = [
    b"0",
    b"-1",
    b"1",
    b"2",
    b"0.5",
    b"-0.0",
    b"1e-320",
    b"1e-9",
    b"1e9",
    b"1e300",
    b"-1e300",
    b"1e999",
    b"nan",
    b"-inf",
    b"4294967296",
    b"1000000000000",
    b"9" * 25,
    b"9" * 400,
    b"9" * 5000,
    b"true",
    b"null",
    b'"x"',
    b"[]",
]
TOKENS = [
    b"\n",
    b'"',
    b",",
    b"=",
    b"-1",
    b"nan",
    b"inf",
    b"1e999",
    b"9" * 400,
    b"[" * 1200,
    b"{" * 1200,
    b"\xff\xfe",
    b"\xc3\xa4",
    b"\x00" * 9,
    b"null",
    b"{}",
    b"a." * 400,
    b"\\ud800",
    b"\\u0000",
    b"../x",
    b"%",
    b"#",
    b";",
]
CHANGES = st.lists(
    st.tuples(
        st.sampled_from(
            [
                "number",
                "number",
                "replace",
                "insert",
                "delete",
                "double",
                "cut",
                "drop line",
                "repeat line",
                "swap lines",
            ]
        ),
        st.floats(0, 1, exclude_max=True),
        st.floats(0, 1, exclude_max=True),
        st.one_of(st.binary(min_size=1, max_size=8), st.sampled_from(TOKENS)),
    ),
    min_size=1,
    max_size=6,
)


def changed(data: bytes, changes: list[tuple[str, float, float, bytes]]) -> bytes:
    """Return bytes to which all this was done."""
    for kind, place, second, other in changes:
        at = int(place * len(data))
        match kind:
            case "number":
                data = _with_number(data, place, HOSTILE[int(second * len(HOSTILE))])
            case "replace":
                data = data[:at] + other + data[at + len(other) :]
            case "insert":
                data = data[:at] + other + data[at:]
            case "delete":
                data = data[:at] + data[at + len(other) :]
            case "double":
                data = data[:at] + data[at : at + 60] + data[at:]
            case "cut":
                data = data[:at] or data
            case _:
                data = _with_lines(data, kind, place, second)
    return data


def _with_number(data: bytes, place: float, number: bytes) -> bytes:
    numbers = list(NUMBERS.finditer(data))
    if not numbers:
        return data
    found = numbers[int(place * len(numbers))]
    return data[: found.start()] + number + data[found.end() :]


def _with_lines(data: bytes, kind: str, place: float, second: float) -> bytes:
    lines = data.split(b"\n")
    one, other = int(place * len(lines)), int(second * len(lines))
    if kind == "drop line":
        del lines[one]
    elif kind == "repeat line":
        lines.insert(other, lines[one])
    else:
        lines[one], lines[other] = lines[other], lines[one]
    return b"\n".join(lines)
