"""Every check of tables at its limit, just beyond it, and well beyond: what is found, with its
whole text.

The tables hold whole numbers of um and mm, so that a limit is met exactly on every processor.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import date
from typing import Any

import msgspec
import numpy as np

from stepdiag.base.findings import Finding
from stepdiag.base.result.members import SetupReport
from stepdiag.base.result.result import Quantity, Result
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.checks import (
    Case,
    refuse,
    run_checks,
    untested_kinds,
)
from stepdiag.exporters.safety.gate import gate_findings, require_clean
from stepdiag.exporters.safety.remarks import backlash_offered, coarse, missed_um, remarks
from stepdiag.exporters.safety.standing import Standing, standing_findings
from stepdiag.exporters.safety.verdicts.lattice import lost_in_field
from stepdiag.exporters.tables.controller import Limits
from stepdiag.exporters.tables.curves import Curve
from stepdiag.exporters.tables.profile import Profile, SignTestRecord
from stepdiag.exporters.tables.tables import Law, Multiplier, Table
from testkit.exact.members import members, setups
from testkit.recorded import plain
from testkit.recorded.exported import own_of, said
from testkit.recorded.profiles import profile_of
from testkit.recorded.results import PLAIN, TURNING, expecting, result_of

TODAY = date(2026, 6, 1)
GRID = (-200.0, -100.0, 0.0, 100.0)
ERROR, COMPENSATION = Law(sense="as-error"), Law(sense="as-compensation")
EXTENDED = Law(sense="as-error", ends="extended")


def table_of(
    um: Sequence[float],
    name: str = "EXX",
    *,
    at: Sequence[float] = GRID,
    kind: str = "eec",
    law: Law = ERROR,
    direction: int = 0,
    quantum: float = 1.0,
    reference: float = -200.0,
    lever: str = "",
    **place: Any,
) -> Table:
    """Return a table by its values."""
    times = (
        Multiplier(
            axis=lever, position_mm=np.array([-150.0, 30.0]), value=np.array([-1.0, 1.0])
        )
        if lever
        else None
    )
    return Table(
        kind=kind,
        input_axis=name[2],
        output_axis=name[1],
        position_mm=np.array(at, dtype=float),
        value_um=np.array(um, dtype=float),
        quantum_um=quantum,
        law=law,
        reference_mm=reference,
        direction=direction,
        place=place,
        multiplier=times,
    )


def curve_of(name: str, um: Sequence[float], u: float, at: Sequence[float] = GRID) -> Curve:
    return Curve(
        name=name,
        position_mm=np.array(at),
        forward_um=np.array(um),
        u_um=np.full(len(at), u),
        parts=(name,),
    )


@dataclass(frozen=True)
class Own:
    """A control whose limits a case sets."""

    inner: Any
    limit: Limits

    def limits(self, table: Table, profile: Profile) -> Limits:
        return self.limit

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


def limited(profile: Profile, **limits: Any) -> Profile:
    return replace(
        profile,
        limits=msgspec.structs.replace(profile.limits, **{"slope_um_mm": None, **limits}),
    )


def with_axis(profile: Profile, letter: str = "X", **changes: Any) -> Profile:
    return replace(
        profile,
        axes={
            **profile.axes,
            letter: msgspec.structs.replace(profile.axes[letter], **changes),
        },
    )


def checked(
    tables: Sequence[Table],
    *,
    before: Sequence[Table] = (),
    profile: Profile | None = None,
    own: Limits | None = None,
    result: Result = PLAIN,
    curves: Sequence[Curve] = (),
    control: str = "siemens",
    whole: bool = False,
) -> list[str]:
    """Return what the checks find; as a ``whole`` what the remarks say, and the kinds that were not
    tried."""
    profile = profile or limited(profile_of("siemens"))
    controller = (
        controller_named(control) if own is None else Own(controller_named(control), own)
    )
    case = Case(
        controller=controller,
        profile=profile,
        result=result,
        curves=curves,
        tables=tables,
        previous=before,
        today=TODAY,
    )
    found = [said(item) for item in run_checks(case)]
    if any("not-finite" in each for each in found):
        return found
    return (
        [
            *found,
            *(said(item) for item in remarks(case)),
            "untested: " + ", ".join(untested_kinds(case)),
        ]
        if whole
        else found
    )


def cases() -> dict[str, Callable[[], Any]]:
    """Return the checks by their names: each a few states around its limit."""
    return {
        "finite": _finite,
        "values": _values,
        "change": _change,
        "slope": _slope,
        "points": _points,
        "reference": _reference,
        "travel": _travel,
        "units-and-axes": _units,
        "reversal": _reversal,
        "quality": _quality,
        "sign": _sign,
        "refusals": _refusals,
        "clean": _clean,
        "gate": _gate,
        "standing": _standing,
        "lost-in-field": _lost_in_field,
        "remarks": _remarks,
        "kinds-of-laws": _laws,
    }


def _finite() -> Any:
    return {
        "not a number": checked([table_of((0, 1, np.nan, 0))]),
        "endless": checked([table_of((0, 1, np.inf, 0))]),
        "place": checked([table_of((0, 1, 2, 0), at=(-200, -100, np.nan, 100))]),
        "one place": checked([table_of((0, 1, 2, 0), at=(-200, -100, -100, 100))]),
        "falling": checked(
            [table_of((0, 1, 2, 0), at=(-200, 0, -100, 100)), table_of((0, 1, 2, 0))]
        ),
        "a micron apart": checked([table_of((0, 1, 1, 0), at=(-200, -100, -99.999, 100))]),
    }


def _values() -> Any:
    profile = limited(profile_of("siemens"), value_um=64.0, warn_value_um=32.0)
    found = {
        f"{um:g} µm": checked([table_of((0, 0, um, 0))], profile=profile)
        for um in (0, 1, 31, 32, 33, 64, 65, -32, -33, -64, -65)
    }
    found |= {
        f"{um:g} µm, own limit": checked(
            [table_of((0, 0, um, 0))], profile=profile, own=Limits(value_um=16.0)
        )
        for um in (16, 17, -17, 65)
    }
    found["own limit above"] = checked(
        [table_of((0, 0, 65, 0))], profile=profile, own=Limits(value_um=128.0)
    )
    found["two directions"] = checked(
        [table_of((0, 0, 30, 0), direction=1), table_of((0, 0, 34, 0), direction=-1)],
        profile=profile,
    )
    found["together"] = checked(
        [table_of((0, 0, 30, 0)), table_of((0, 0, 10, 0), kind="cec", table=4)],
        profile=profile,
    )
    found["against each other"] = checked(
        [table_of((0, 0, 66, 0)), table_of((0, 0, -10, 0), kind="cec", table=4)],
        profile=profile,
    )
    found["incremental"] = checked(
        [table_of((0, 20, 20, 0), law=Law(sense="as-error", data="incremental"))],
        profile=profile,
    )
    found["product"] = checked([table_of((0, 0, 40, 0), lever="Z", table=1)], profile=profile)
    return found


def _change() -> Any:
    profile = limited(profile_of("siemens"), change_um=16.0, slope_um_mm=2.0)
    old = [table_of((0, 1, 2, 3))]
    found = {
        f"to {um:g} µm": checked([table_of((0, 1, um, 3))], before=old, profile=profile)
        for um in (2, 17, 18, 19, -14, -15)
    }
    found["of zeros"] = checked(
        [table_of((0, 1, 40, 3))], before=[table_of((0, 0, 0, 0))], profile=profile
    )
    found["to zeros"] = checked(
        [table_of((0, 0, 0, 0))], before=[table_of((0, 40, 0, 0))], profile=profile
    )
    found["of another"] = checked(
        [table_of((0, 1, 40, 3))],
        before=[table_of((0, 1, 2, 3), "EYX", kind="cec")],
        profile=profile,
    )
    found["of two"] = checked(
        [table_of((0, 1, 40, 3))],
        before=[*old, table_of((0, 0, 30, 0), kind="cec")],
        profile=profile,
    )
    found["by two"] = checked(
        [table_of((0, 1, 2, 3)), table_of((0, 0, 20, 0), kind="cec", table=0)],
        before=old,
        profile=profile,
    )
    found["one direction"] = checked(
        [table_of((0, 1, 40, 3), direction=-1)], before=old, profile=profile
    )
    return found


def _slope() -> Any:
    profile = limited(profile_of("siemens"), value_um=900.0, warn_value_um=900.0)
    found = {
        f"{um:g} µm in 100 mm": checked([table_of((0, 0, um, um))], profile=profile)
        for um in (19, 20, 21, -20, -21)
    }
    steep = limited(
        profile_of("siemens"), slope_um_mm=0.5, value_um=900.0, warn_value_um=900.0
    )
    found |= {
        f"{um:g} µm in 100 mm, to 0.5": checked([table_of((0, um, um, um))], profile=steep)
        for um in (49, 50, 51)
    }
    none = Limits(slope_um_mm=None)
    found["no limit"] = checked([table_of((0, 0, 500, 500))], profile=profile, own=none)
    for um in (24, 25, 26, -25, -26):
        found[f"{um:g} µm to the next, 25"] = checked(
            [table_of((0, um, um, um))], profile=profile, own=replace(none, neighbour_um=25.0)
        )
        found[f"{um:g} µm to the next, a 4th of a mm"] = checked(
            [table_of((0, um, um, um))],
            profile=profile,
            own=replace(none, neighbour_um_mm=0.25),
        )
    both = replace(none, neighbour_um=30.0, neighbour_um_mm=0.25)
    found["the narrower"] = checked([table_of((0, 0, 0, 27))], profile=profile, own=both)
    found["the wider"] = checked(
        [table_of((0, 28, 28, 28), at=(-200, -40, 0, 100))], profile=profile, own=both
    )
    found["unequal"] = checked(
        [table_of((0, 5, 5, 5), at=(-200, -190, 0, 100))], profile=profile
    )
    return found


def _points() -> Any:
    profile = limited(profile_of("siemens"))
    found = {}
    for points in (3, 4, 5):
        found[f"4 of {points}"] = checked(
            [table_of((0, 1, 2, 0))], profile=profile, own=Limits(points=points)
        )
        found[f"4 of {points}, the profile's"] = checked(
            [table_of((0, 1, 2, 0))], profile=limited(profile, points=points)
        )
    found["the less of both"] = checked(
        [table_of((0, 1, 2, 0))], profile=limited(profile, points=3), own=Limits(points=2)
    )
    three = [table_of((0, 1, 2, 0), "EYX", kind="cec", table=number) for number in range(3)]
    for held in (2, 3, 4):
        found[f"3 tables of {held}"] = checked(
            three, profile=profile, own=Limits(tables=held)
        )
    for number in (2, 3, 4):
        found[f"number {number} of 4"] = checked(
            [table_of((0, 1, 2, 0), "EYX", kind="cec", table=number)],
            profile=profile,
            own=Limits(tables=4),
        )
    found["without numbers"] = checked(
        [table_of((0, 1, 2, 0), name) for name in ("EXX", "EYX")],
        profile=profile,
        own=Limits(tables=1),
    )
    return found


def _reference() -> Any:
    profile = limited(profile_of("siemens"))
    found = {
        f"{um:g} µm": checked([table_of((um, 1, 2, 0))], profile=profile)
        for um in (0, 0.25, 0.5, 0.75, 1, -0.5, -0.75)
    }
    for wanted in (2.0, -2.0):
        for um in (2, 2.5, 2.75, -2.75, 3):
            found[f"{um:g} µm, {wanted:g} wanted"] = checked(
                [table_of((um, 1, 2, 0))], profile=profile, own=Limits(reference_um=wanted)
            )
    found["extended"] = checked(
        [table_of((5, 1), at=(-200, 100), law=EXTENDED)], profile=profile
    )
    found["- direction"] = checked([table_of((5, 1, 2, 0), direction=-1)], profile=profile)
    found["+ direction"] = checked([table_of((5, 1, 2, 0), direction=1)], profile=profile)
    found["product"] = checked([table_of((5, 1, 2, 0), lever="Z")], profile=profile)
    found["in the middle"] = checked(
        [table_of((5, 1, 3, 0), reference=-50.0)], profile=profile
    )
    return found


def _travel() -> Any:
    profile = limited(profile_of("siemens"))
    found = {}
    for travel in (
        (-200.0, 100.0),
        (-200.5, 100.0),
        (-200.0, 100.5),
        (-190.0, 90.0),
        (-300.0, 300.0),
        (-200.0005, 100.0005),
    ):
        found[f"{travel}"] = checked(
            [table_of((2, 1, 2, 3.5))], profile=with_axis(profile, travel_mm=travel)
        )
    wide = with_axis(profile, travel_mm=(-300.0, 300.0))
    found["extended"] = checked(
        [table_of((0, 1), at=(-200, 100), law=EXTENDED)], profile=wide
    )
    found["empty"] = checked([table_of((0, 0, 0, 0))], profile=wide)
    found["unknown"] = checked([table_of((2, 1, 2, 3.5))], profile=profile)
    return found


def _units() -> Any:
    tables = [table_of((0, 1, 2, 0))]
    inch = {
        control: checked(
            tables,
            profile=replace(
                profile_of("siemens"),
                machine=msgspec.structs.replace(profile_of("siemens").machine, units="inch"),
            ),
            own=Limits(),
            control=control,
        )
        for control in (
            "siemens",
            "fanuc",
            "heidenhain",
            "linuxcnc",
            "beckhoff",
            "mitsubishi",
            "fagor",
        )
    }
    twice = with_axis(
        with_axis(limited(profile_of("siemens")), "Y", name="X1"), "Z", name="X1"
    )
    return {"inch": inch, "one name": checked(tables, profile=twice)}


def _reversal() -> Any:
    both = [table_of((0, 1, 2, 0), direction=1), table_of((0, 1, 1, 0), direction=-1)]
    cross = [table_of((0, 1, 2, 0), "EYX", kind="cec", direction=1)]
    profile = limited(profile_of("siemens"))
    found: dict[str, Any] = {}
    for backlash in (None, 0.0, 1.0, -1.5):
        of_axis = with_axis(profile, backlash_um=backlash)
        found[f"backlash {backlash}"] = checked(both, profile=of_axis)
        found[f"backlash {backlash}, another axis"] = checked(cross, profile=of_axis)
        found[f"backlash {backlash}, not looked at"] = checked(
            both, profile=of_axis, own=Limits(ends_backlash=True)
        )
    found["one table"] = checked(
        [table_of((0, 1, 2, 0))], profile=with_axis(profile, backlash_um=3.0)
    )
    return found


def _quality() -> Any:
    tables = [table_of((0, 4, 2, 0))]

    def of(
        stated: Any, curves: Sequence[Curve] = (), findings: tuple[Finding, ...] = ()
    ) -> list[str]:
        return checked(
            tables,
            result=replace(PLAIN, setups=setups(**stated), findings=findings),
            curves=curves,
            whole=bool(findings),
        )

    found = {
        f"repeats to {um:g} µm": of({"ppp": {"passes": [1, 2], "repeatability_um": um}})
        for um in (0, 1, 2, 2.25, 3, -1)
    }
    found["the worst of two"] = of(
        {
            "ppp": {"repeatability_um": 2.5},
            "npp": {"repeatability_um": 3.5},
            "pnp": {"repeatability_um": None},
            "ppn": {},
        }
    )
    for um in (1.75, 2.0, 2.25):
        found[f"{um:g} µm beside U of 1"] = of({}, [curve_of("EXX", (0, um, 0, 0), 1.0)])
        found[f"{um:g} µm beside U of 1 and one beyond"] = of(
            {}, [curve_of("EXX", (0, um, 0, 0), 1.0), curve_of("EYY", (0, 9, 0, 0), 1.0)]
        )
    found["nothing known of U"] = of({}, [curve_of("EXX", (0, 0, 0, 0), np.nan)])
    errors = tuple(
        Finding(code=f"code-{severity}", severity=severity, text="what it says")
        for severity in ("info", "warning", "error")
    )
    found["what the result says"] = of({}, findings=errors)
    return found


def _sign() -> Any:
    profile = limited(profile_of("siemens"))
    tables = [
        table_of((0, 1, 2, 0)),
        table_of((0, 1, 2, 0), "EYX", kind="cec", law=COMPENSATION),
    ]

    def of(*records: tuple[str, date, str]) -> list[str]:
        about = {
            "machine": profile.machine.name,
            "control": "siemens",
            "measuring_system": "1",
        }
        files = {"bump_sha256": ["b" * 64], "runs_sha256": ["a" * 64]}
        tests = tuple(
            SignTestRecord(kind=kind, date=day, verdict=verdict, **about, **files)
            for kind, day, verdict in records
        )
        return checked(tables, profile=replace(profile, sign_tests=tests), whole=True)

    found: dict[str, Any] = {"none": of()}
    for day in (
        date(2026, 6, 1),
        date(2026, 6, 2),
        date(2025, 6, 1),
        date(2025, 5, 31),
        date(2025, 6, 2),
    ):
        found[f"{day}"] = of(("eec", day, "as-error"), ("cec", day, "as-compensation"))
    found["contradicted"] = of(
        ("eec", date(2026, 5, 1), "as-compensation"), ("cec", date(2026, 5, 1), "as-error")
    )
    found["of another kind"] = of(("cec-product", date(2026, 5, 1), "as-compensation"))
    found["neutral"] = checked(
        tables,
        control="neutral",
        profile=limited(profile_of("neutral")),
        own=Limits(),
        whole=True,
    )
    return found


def _refusals() -> Any:
    one, two, three, note = (
        Finding(code="a-warning", severity="warning", text="first"),
        Finding(code="an-error", severity="error", text="second"),
        Finding(code="b-warning", severity="warning", text="third"),
        Finding(code="a-note", severity="info", text="fourth"),
    )
    found = {}
    for name, findings in (
        ("warning", [one]),
        ("two", [one, three]),
        ("error", [one, two, three]),
        ("note", [note]),
        ("all", [note, three, two, one]),
    ):
        for accept in ((), ("a-warning",), ("a-warning", "b-warning", "an-error")):
            found[f"{name}, accepted {', '.join(accept) or 'nothing'}"] = plain.attempted(
                lambda findings=findings, accept=accept: refuse(findings, accept, "where")
            )
    return found


def _clean() -> Any:
    texts = (
        "X 1.5 -2.25",
        "X nan",
        "X -inf",
        "infinity 2",
        "NANO",
        "Xnan_1",
        "a_inf",
        "1e5",
        "X=1E-3",
        "2.e+7",
        "A1e5",
        "1e5x",
        "123456789012",
        "1234567890123",
        "0.123456789",
        "0.1234567890",
        "-1234567890123.5",
        "X1234567890123",
        "1.2.3",
        ".5",
        " .5",
        "1..5",
        "--5",
        "+-5",
        "-+5",
        "1-.5",
        "5.",
        "-5.0e",
        "N.1",
        "x.5y",
        "0.0000000001",
    )
    found = {
        text: plain.attempted(
            lambda text=text: require_clean([ControlFile(name="a.txt", data=text.encode())])
        )
        for text in texts
    }
    many = ControlFile(name="many.txt", data=b"ok 1\nnan\ninf\n\xe4\n1e9\n.5\n")
    found["many"] = plain.attempted(lambda: require_clean([many]))
    found["own lines"] = plain.attempted(
        lambda: require_clean([many], [ControlFile(name="o", data=b"nan\ninf\n\xe4\n")])
    )
    found["a note"] = plain.attempted(lambda: require_clean([replace(many, role="note")]))
    return found


def _gate() -> Any:
    profile = limited(profile_of("siemens"))
    controller = controller_named("siemens")

    def of(*read: Table, travel: tuple[float, float] | None = None) -> list[str]:
        own = limited(with_axis(profile, travel_mm=travel))
        case = Case(
            controller=controller,
            profile=own,
            result=PLAIN,
            curves=(),
            tables=read,
            previous=(),
            today=TODAY,
        )
        return [said(item) for item in gate_findings(case, Standing(after=read, new=read))]

    right = table_of((-3.3, 0, 3.8, 8.5), quantum=0.1, reference=-100.0)
    found: dict[str, Any] = {
        "right": of(right),
        "turned": of(replace(right, value_um=-right.value_um)),
        "nan": of(table_of((0, np.nan, 0, 0))),
    }
    for travel in (
        (-200.0, 100.0),
        (-100.0, 0.0),
        (-99.0, 100.0),
        (-100.0, 100.0),
        (-200.0, 0.0),
        (-200.0, -1.0),
        (-200.0, 1.0),
    ):
        found[f"travel {travel}"] = of(right, travel=travel)
    found["empty, beyond the travel"] = of(
        replace(right, value_um=0.0 * right.value_um), travel=(-10.0, 10.0)
    )
    found["extended, beyond the travel"] = of(
        replace(right, law=EXTENDED), travel=(-10.0, 10.0)
    )
    return found


def _standing() -> Any:
    profile = limited(profile_of("siemens"))
    off = profile
    on = replace(
        profile, machine=msgspec.structs.replace(profile.machine, measured_with="on")
    )
    few = replace(
        profile, machine=msgspec.structs.replace(profile.machine, functions=["EXX"])
    )
    exx, old, eyx = (
        table_of((0, 4, 2, 0)),
        table_of((0, 9, 2, 6), axis="old"),
        table_of((0, 1, 5, 0), "EYX", kind="cec", table=0),
    )
    wide = table_of((7, 0, 9, 2, 6, 9), at=(-300, -200, -100, 0, 100, 200), axis="old")
    product = table_of((0, 4, 2, 0), "EYX", kind="cec-product", lever="Z", table=4)
    states = {
        "replaced": ((old,), (exx,), (exx,)),
        "left active": ((old,), (old, exx), (exx,)),
        "left, of another": ((eyx,), (eyx, exx), (exx,)),
        "partly overwritten": (
            (eyx,),
            (replace(eyx, value_um=eyx.value_um + 1), exx),
            (exx,),
        ),
        "foreign": ((), (eyx, exx), (exx,)),
        "lost": ((eyx,), (exx,), (exx,)),
        "lost, empty": ((replace(eyx, value_um=0 * eyx.value_um),), (exx,), (exx,)),
        "shrunk": ((wide,), (exx,), (exx,)),
        "shrunk a little": (
            (replace(wide, value_um=np.array([1.5, 1, 9, 2, 6, 6.75])),),
            (exx,),
            (exx,),
        ),
        "shrunk by a micron": (
            (replace(wide, value_um=np.array([2.0, 1, 9, 2, 6, 7.0])),),
            (exx,),
            (exx,),
        ),
        "shrunk, two directions": (
            (replace(wide, direction=-1), replace(wide, direction=1)),
            (exx,),
            (exx,),
        ),
        "product stays": ((product,), (product, eyx), (eyx,)),
        "product stays, of another": ((product,), (product, exx), (exx,)),
        "product lost": ((product,), (exx,), (exx,)),
        "product changed": (
            (product,),
            (
                replace(
                    product,
                    multiplier=replace(product.multiplier, value=np.array([-1.0, 0.5])),
                ),
                exx,
            ),
            (exx,),
        ),
        "slope": ((table_of((0, 1, 1, 1.5), axis="old"),), (exx,), (exx,)),
        "slope of a micron": ((table_of((0, 1, 1, 1.0), axis="old"),), (exx,), (exx,)),
        "slope in two directions": (
            (table_of((0, 1, 1, 3), direction=1), table_of((0, 1, 1, 2), direction=-1)),
            (exx,),
            (exx,),
        ),
    }
    results = {
        "plain": PLAIN,
        "shape": result_of(shape_only=("EXX",)),
        "without": result_of(shapes={"EXX": None}),
        "expecting": expecting(),
    }
    found: dict[str, Any] = {}
    for name, (before, after, new) in states.items():
        standing = Standing(before=before, after=after, new=new)
        found[name] = {
            "staying": [str(one.label) for one in standing.staying],
            "lost": [str(one.label) for one in standing.lost()],
        } | {
            f"{which}, {state}": [
                [said(item) for item in standing_findings(standing, result, own)],
                [[str(one.label) for one in each] for each in standing.acting(result, own)],
            ]
            for which, result in results.items()
            for state, own in (("off", off), ("on", on), ("few", few))
            if which == "plain" or state == "off"
        }
    return found


def _lost_in_field() -> Any:
    unsquare = replace(
        PLAIN, squareness={**PLAIN.squareness, "C0Y": Quantity(value=None, u=None)}
    )
    results = {
        "plain": PLAIN,
        "shape": result_of(shape_only=("EXX", "EZZ")),
        "without": result_of(shapes={"EYX": None, "EZZ": None}),
        "unsquare": unsquare,
    }
    fields = {
        "nothing": np.zeros_like,
        "slopes": lambda points: np.stack(
            [0.01 * points[:, 0], 0.01 * points[:, 0], 0.01 * points[:, 2]], axis=-1
        ),
        "leans": lambda points: np.stack(
            [0.01 * points[:, 1], 0 * points[:, 0], 0.006 * points[:, 2]], axis=-1
        ),
        "hardly": lambda points: np.stack(
            [0.003 * points[:, 1], 0.003 * points[:, 0], 0.005 * points[:, 2]], axis=-1
        ),
        "turned": lambda points: np.stack(
            [0.01 * points[:, 1], -0.01 * points[:, 0], 0 * points[:, 2]], axis=-1
        ),
    }
    return {
        f"{name}, {field}": [said(item) for item in lost_in_field(result, moved)]
        for name, result in results.items()
        for field, moved in fields.items()
    }


def _remarks() -> Any:
    found: dict[str, Any] = {}
    for ends in (False, True):
        for letter in "XYZ":
            found[f"backlash {letter} {ends}"] = [
                said(item) for item in backlash_offered(TURNING, letter, ends_backlash=ends)
            ]
    for value, u in ((3.0, 1.0), (3.25, 1.0), (-3.0, 1.0), (-3.25, 1.0), (0.5, 0.0)):
        known = members(backlash={"X": {"value": value, "u": u}})
        found[f"backlash of {value} with {u}"] = [
            said(item)
            for item in backlash_offered(replace(PLAIN, **known), "X", ends_backlash=False)
        ]
    found["no numbers"] = [
        said(item) for item in backlash_offered(PLAIN, "X", ends_backlash=False)
    ]
    grid, at = np.array([0.0, 10.0, 20.0]), np.array([-5.0, 0.0, 5.0, 10.0, 15.0, 20.0, 25.0])
    found["missed"] = [
        missed_um(grid, at, np.array(um, dtype=float))
        for um in ((9, 0, 4, 0, -6, 0, 9), (1, 2, 3, 4, 5, 6, 7), (0, 0, 0, 0, 1, 0, 0))
    ]
    for um in (0.25, 0.5, 0.75):
        found[f"coarse {um}"] = [
            said(item) for item in coarse("these tables", {"EXX": um, "EYY": 0.1})
        ]
    for um in (0.25, 0.5, 0.75, -0.75):
        found[f"ends {um}"] = checked(
            [table_of((0, 1, 2, um)), table_of((um, 1, 2, 0), "EYX", kind="cec")], whole=True
        )
    driven = {
        name: SetupReport(passes=passes)
        for name, passes in {"a": (1,), "b": (2,), "d": (1, 2), "e": ()}.items()
    }
    warned = (
        Finding(code="w", severity="warning", text="text"),
        Finding(code="i", severity="info", text="text"),
    )
    found["runs and data"] = checked(
        [table_of((0, 1, 2, 0))],
        result=replace(PLAIN, setups=driven, findings=warned),
        whole=True,
    )
    found["with files"] = checked(
        [table_of((0, 1, 2, 0))],
        profile=profile_of("siemens", files=own_of("siemens")),
        whole=True,
    )
    both = limited(
        replace(
            profile_of("siemens"),
            machine=msgspec.structs.replace(profile_of("siemens").machine, direction="both"),
        )
    )
    turned = replace(
        curve_of("EXX", (0, 1, 2, 0), 0.5), reverse_um=np.array([0.0, 0.0, 1.0, 1.0])
    )
    for name, own in (("mean", limited(profile_of("siemens"))), ("both", both)):
        for which, curve in (
            ("turned", turned),
            ("plain", replace(turned, reverse_um=None)),
            ("straightness", replace(turned, name="EYX")),
        ):
            for ways in (0, 1):
                tables = [table_of((0, 1, 2, 0), curve.name, direction=ways)]
                found[f"{name}, {which}, {ways}"] = checked(
                    tables, profile=own, curves=[curve], result=TURNING, whole=True
                )
    found["shape alone"] = checked(
        [table_of((0, 1, 2, 0))],
        curves=[
            replace(turned, slope_known=False),
            replace(turned, name="EYY", slope_known=False),
        ],
        whole=True,
    )
    return found


def _laws() -> Any:
    """What the laws make of one table: absolute values and movement in both directions."""
    at = np.array([-250.0, -200.0, -150.0, -100.0, -50.0, 0.0, 50.0, 100.0, 150.0])
    found: dict[str, Any] = {}
    for sense in ("as-error", "as-compensation"):
        for data in ("absolute", "incremental"):
            for between in ("linear", "stepped"):
                for ends in ("held", "extended"):
                    law = Law(sense=sense, data=data, between=between, ends=ends)
                    one = replace(
                        table_of(
                            (0, 4, -2, 6),
                            law=law,
                            reference=-100.0,
                            direction=1,
                            file="f",
                            table=3,
                        ),
                        offset_um=1.5,
                    )
                    found[f"{sense} {data} {between} {ends}"] = [
                        str(one.label),
                        str(one.identity),
                        one.absolute_um.tolist(),
                        *_moved(one, at),
                    ]
    lever = Multiplier(
        axis="Z", position_mm=np.array([-150.0, 30.0]), value=np.array([-0.5, 1.0])
    )
    found["multipliers"] = [
        [each.at(at).tolist(), each.is_straight, list(each.line)]
        for each in (
            lever,
            replace(lever, ends="extended"),
            replace(lever, value=np.array([1.0, 1.0])),
            Multiplier(
                axis="Z",
                position_mm=np.array([0.0, 1.0, 4.0]),
                value=np.array([0.0, 1.0, 2.0]),
            ),
        )
    ]
    return found


def _moved(one: Table, at: np.ndarray) -> list[Any]:
    from stepdiag.exporters.tables.tables import correction_um, joined, plain_rows, zeroed

    straight = joined(one)
    return [
        correction_um(one, at, 1).tolist(),
        correction_um(one, at, -1).tolist(),
        correction_um(straight, at, 1).tolist(),
        straight.law.between,
        plain.figures(plain_rows(one)),
        [each.label for each in zeroed([one])],
    ]
