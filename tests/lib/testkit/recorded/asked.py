"""Profiles with one field that is wrong, for every field and every way to be wrong; settings of any
form."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Literal

import msgspec

from stepdiag.base.settings import convert, nearest, read_toml, require_answers
from stepdiag.exporters.profiles.file import parse_profile, quick_profile
from stepdiag.exporters.profiles.registry import CONTROLLERS, controller_named
from stepdiag.exporters.safety.identity import require_same_machine
from stepdiag.exporters.tables.profile import Profile
from testkit.recorded import plain
from testkit.recorded.profiles import SECTIONS, profile_of, profile_text
from testkit.recorded.results import PLAIN, VOLUME, result_of

VALUES = (
    "-1",
    "0",
    "1",
    "2",
    "7",
    "128",
    "100001",
    "1e300",
    "-0.5",
    "0.5",
    '"x"',
    '"?"',
    "true",
    "[1.0, 2.0]",
    '["EXX"]',
    "{}",
    "{ X = 1 }",
)
TESTED = '[[sign_test]]\nkind = "eec"\ndate = 2026-01-31\nverdict = "as-error"\n'
COMMON = {
    "machine": {
        "name",
        "units",
        "direction",
        "functions",
        "squareness_into",
        "existing",
        "active_sha256",
        "measured_with",
        "controller",
    },
    "axes.X": {
        "name",
        "step_mm",
        "reference_mm",
        "start_mm",
        "end_mm",
        "travel_mm",
        "backlash_um",
        "working_mm",
    },
    "limits": {"value_um", "warn_value_um", "change_um", "slope_um_mm", "points"},
}


def cases() -> dict[str, Callable[[], Any]]:
    """Return the fields by their section."""
    found: dict[str, Callable[[], Any]] = {
        f"common-{name}": lambda name=name, fields=fields: _fields(
            "siemens", name, sorted(fields)
        )
        for name, fields in COMMON.items()
    }
    for control in SECTIONS:
        fields = [
            field.name for field in msgspec.structs.fields(controller_named(control).options)
        ]
        if fields:
            found[f"section-{control}"] = lambda control=control, fields=fields: _fields(
                control, control, fields
            )
    found["section-fanuc-axis"] = lambda: _fields(
        "fanuc",
        "fanuc.axes.X",
        ["number", "reference_point", "reverse_first_point", "magnification", "inclination"],
    )
    found["whole"] = _whole
    found["grids"] = _grids
    found["answers"] = _answers
    found["models"] = _models
    found["machines"] = _machines
    return found


def _fields(control: str, section: str, fields: list[str]) -> Any:
    """Return what is said of every value of every field of a section."""
    whole = profile_text(control, axis={"X": "start_mm = -200.0\nend_mm = 100.0"})
    found: dict[str, Any] = {}
    for field in [*fields, fields[0][:-1] + "q", "other"]:
        for value in VALUES if field in fields else VALUES[:1]:
            text = _with(whole, section, field, value)
            found[f"{field} = {value}"] = plain.attempted(
                partial(_read, text, control, section, field)
            )
    return plain.grouped(found)


def _read(text: str, control: str, section: str, field: str) -> Any:
    return _taken(
        parse_profile(text, "p.toml", controller_named(control), VOLUME, {}), section, field
    )


def _taken(profile: Profile, section: str, field: str) -> Any:
    """Return a field as it was taken."""
    holder: Any = {
        "machine": profile.machine,
        "axes.X": profile.axes.get("X"),
        "limits": profile.limits,
    }.get(section, profile.options)
    if section == "fanuc.axes.X":
        holder = holder.axes["X"]
    value = getattr(holder, field)
    return value if isinstance(value, bool | int | float | str | type(None)) else str(value)


def _with(text: str, section: str, field: str, value: str) -> str:
    """Return a TOML text with one field of a section put in the place of its own, if it has one."""
    lines = [line for line in text.split("\n") if line]
    start = lines.index(f"[{section}]") if f"[{section}]" in lines else len(lines)
    if start == len(lines):
        lines.append(f"[{section}]")
    end = next(
        (n for n in range(start + 1, len(lines)) if lines[n].startswith("[")), len(lines)
    )
    kept = [
        line for line in lines[start + 1 : end] if line.partition("=")[0].strip() != field
    ]
    return "\n".join([*lines[: start + 1], *kept, f"{field} = {value}", *lines[end:]]) + "\n"


def _whole() -> Any:
    """Profiles as a whole: sections, kinds of sign tests, files."""
    base = profile_text("siemens")
    texts = {
        "right": base,
        "another control": base.replace('"siemens"', '"fanuc"'),
        "unknown section": base + "[limts]\n",
        "foreign section": base + "[fanuc]\n",
        "no axes": base.partition("[axes.X]")[0],
        "an axis A": base + "[axes.A]\n",
        "no machine": "[axes.X]\n",
        "no TOML": base + "[",
        "empty": "",
        "machine is no table": "machine = 3\n",
        "section is no table": base.replace(
            "[siemens]\nmeasuring_system = 1\nold_enabled = true\nold_weight = 1.0", ""
        ).replace("[machine]", "siemens = 3\n[machine]"),
        "a byte order mark": "\ufeff" + base,
        "deep": base + "a" + ".a" * 30 + " = 1\n",
        "missing axis field": base.replace("step_mm = 100.0", ""),
        "a sign test": base + TESTED,
        "of another kind": base + TESTED + TESTED.replace("eec", "com"),
        "of another verdict": base
        + '[[sign_test]]\nkind = "eec"\ndate = 2026-01-31\nverdict = "right"\n',
        "without a date": base + '[[sign_test]]\nkind = "eec"\nverdict = "as-error"\n',
        "dated by a text": base
        + '[[sign_test]]\nkind = "eec"\ndate = "soon"\nverdict = "as-error"\n',
        "files not given": base.replace("existing = []", 'existing = ["a.ini", "b.ini"]'),
        "on without files": base.replace('"off"', '"on"'),
        "only X and Z": base.replace("[axes.Y]", "[axes.Z]\n#").partition("[axes.Z]\nname")[
            0
        ],
    }
    found: dict[str, Any] = {
        name: plain.attempted(
            lambda text=text: _said(
                parse_profile(text, "p.toml", controller_named("siemens"), VOLUME, {})
            )
        )
        for name, text in texts.items()
    }
    found["without a volume"] = plain.attempted(
        lambda: _said(profile_of("siemens", volume=None))
    )
    found["with files"] = plain.attempted(
        lambda: _said(profile_of("siemens", files={"A/b.ini": b"x", "c.ini": b"y"}))
    )
    found["quick"] = {
        name: _said(quick_profile(control, VOLUME, 25.0))
        for name, control in CONTROLLERS.items()
    }
    found["options of another"] = plain.attempted(
        lambda: profile_of("siemens").options_as(controller_named("fanuc").options)
    )
    found["axis of another"] = plain.attempted(
        lambda: profile_of("siemens").letter_of("X9", "a.ini: line 3")
    )
    found["no such axis"] = plain.attempted(lambda: profile_of("siemens").axis("W"))
    return found


def _said(profile: Profile) -> Any:
    return {
        "machine": str(profile.machine),
        "axes": {letter: str(axis) for letter, axis in profile.axes.items()},
        "limits": str(profile.limits),
        "tests": [str(each) for each in profile.sign_tests],
        "options": str(profile.options),
        "files": [f"{file.name} {file.data!r} {file.role}" for file in profile.existing],
        "assumed": profile.assumed,
        "source": profile.source,
        "zone": {letter: list(ends) for letter, ends in profile.zone.items()},
    }


def _grids() -> Any:
    found = {}
    for start, end, step in (
        (0, 100, 10),
        (0, 100, 100),
        (0, 100, 101),
        (0, 100, 30),
        (0, 100, 33.333333333),
        (0, 100, 33.3333333333333),
        (0, 100, 200),
        (100, 0, 10),
        (0, 0, 10),
        (0, 0.5, 1),
        (-50, 50, 12.5),
        (0, 20000, 1),
        (0, 20001, 1),
        (0, 1, 1e-6),
        (0, 100, 150),
        (0, 100, 250),
        (0, 1000, 7),
    ):
        axis = f"start_mm = {float(start)}\nend_mm = {float(end)}\nreference_mm = 0.0"
        profile = profile_of("siemens", steps={"X": float(step)}, axis={"X": axis})
        found[f"{start:g} to {end:g} by {step!r}"] = plain.attempted(
            lambda profile=profile: [
                len(profile.grid_mm("X")),
                *profile.grid_mm("X")[[0, 1, -1]].tolist(),
            ]
        )
    found["no ends"] = plain.attempted(
        lambda: profile_of("siemens", volume=None).grid_mm("Y")
    )
    return found


def _answers() -> Any:
    texts = (
        'a = "?"\n',
        'a = 1\nb = ["x", "?"]\n[c]\nd = "?"\n[[e]]\nf = "?"\n',
        "a = 1\n",
        "[a.b]\nc = '?'\n",
    )
    found: dict[str, Any] = {
        text: plain.attempted(
            lambda text=text: require_answers(read_toml(text, "s.toml"), "s.toml")
        )
        for text in texts
    }
    for depth in (18, 19, 20, 21, 22):
        name = ".".join(["a"] * depth)
        for text in (f"{name} = 1\n", f"x = 1\n\n[{name}]\n"):
            found[f"{depth} parts {text[0]}"] = plain.attempted(
                lambda text=text: len(str(read_toml(text, "s.toml"))) > 0
            )
    found["nearest"] = {
        word: nearest(word, ["measuring_system", "eec_points", "products"])
        for word in ("products", "product", "eec", "zzz", "mesuring")
    }
    return found


class _Inner(msgspec.Struct, forbid_unknown_fields=True):
    whole: int
    least: float = 0.0


class _Model(msgspec.Struct, forbid_unknown_fields=True):
    """A field of every form."""

    text: str = ""
    flag: bool = False
    number: float = 0.0
    word: Literal["one", "two"] = "one"
    pair: tuple[float, float] = (0.0, 0.0)
    several: tuple[int, ...] = ()
    some: list[int] = []
    maybe: int | None = None
    inner: _Inner | None = None
    by_word: dict[Literal["x", "y"], float] = {}
    inners: list[_Inner] = []
    pairs: list[tuple[float, float]] = []


def _models() -> Any:
    texts: Iterator[str] = (
        f"{field} = {value}\n"
        for field in _Model.__struct_fields__
        for value in (
            "1",
            "1.5",
            '"one"',
            '"tow"',
            "true",
            "[1, 2]",
            "[1, 2, 3]",
            '[1, "x"]',
            "[[1, 2]]",
            "[[1, 2, 3]]",
            "{ x = 1 }",
            "{ z = 1 }",
            "{ x = true }",
            "{ whole = 1 }",
            "{ whole = 1.5 }",
            "{ least = 1 }",
            "{ whole = 1, more = 2 }",
            "[{ whole = 1 }, { whole = 'x' }]",
            "inf",
            '"a\\u0000b"',
            "1e308",
            "[]",
            f'"{"long " * 20}"',
        )
    )
    found = {
        text: plain.attempted(
            lambda text=text: str(convert(read_toml(text, "s.toml"), _Model, "s.toml"))
        )
        for text in texts
    }
    return plain.grouped(found)


def _machines() -> Any:
    found = {}
    for survey in (
        "test machine",
        "Test  Machine",
        "TESTMACHINE",
        "",
        "machine",
        "?",
        " Machine ",
        "other",
        3,
        None,
    ):
        result = result_of(survey={"machine": survey})
        found[f"{survey}"] = plain.attempted(
            lambda result=result: require_same_machine(result, profile_of("siemens"))
        )
    found["no survey"] = plain.attempted(
        lambda: require_same_machine(
            PLAIN, quick_profile(controller_named("siemens"), VOLUME, 60.0)
        )
    )
    return found
