"""Sign tests: bumps for every control and function, and what is concluded from runs of every
size."""

from collections.abc import Callable, Sequence
from datetime import date
from typing import Any

import numpy as np

from stepdiag.base.readings.readings import NO_ZERO, Readings, make_readings
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.sign_evidence import record, subject
from stepdiag.exporters.safety.sign_run import from_readings
from stepdiag.exporters.safety.sign_test import Bump, bump, verdict
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import correction_um
from testkit import references
from testkit.recorded import plain
from testkit.recorded.exported import LISTS, WIDE, fanuc_section
from testkit.recorded.profiles import profile_of

FINE = {"X": 25.0, "Y": 20.0, "Z": 15.0}
SHARES = (
    0.0,
    0.03,
    0.049,
    0.051,
    0.1,
    0.2,
    0.3,
    0.45,
    0.5,
    0.524,
    0.526,
    0.8,
    1.0,
    1.3,
    1.89,
    1.91,
    2.0,
    2.3,
    2.7,
    4.0,
    5.2,
    9.0,
    12.0,
    20.0,
    30.0,
    60.0,
    900.0,
    1500.0,
)
FEW = (0.03, 0.4, 1.0, 2.0, 10.0)


def as_data(test: Bump, *, files: bool = True) -> dict[str, Any]:
    """Return all of a bump."""
    return {
        "function": test.function,
        "tables": [plain.table(one) for one in test.tables],
        "reference": test.reference_mm,
        "top": test.top_mm,
        "beyond": test.beyond_mm,
        "lever": test.lever,
        "expected": test.expected_um,
    } | (
        {"files": plain.files(test.files), "restore": plain.files(test.restore)}
        if files
        else {}
    )


def _bumped(
    control: str, function: str, profile: Profile | None = None, *, files: bool = True
) -> Any:
    return plain.attempted(
        lambda: as_data(
            bump(
                controller_named(control),
                profile or profile_of(control, steps=FINE),
                function,
            ),
            files=files,
        )
    )


def _judged(
    control: str, function: str, profile: Profile, shares: Sequence[float] = FEW
) -> Any:
    """Return the verdicts on runs in which the axis moved any share of what was expected, both
    ways, and on runs that go wrong."""

    def act() -> dict[str, Any]:
        test = bump(controller_named(control), profile, function)
        grid = profile.grid_mm(function[2])
        times = 1.0
        lever = 0.0 if test.lever is None else test.lever[1]
        moved = sum(
            (
                correction_um(one, grid)
                * (
                    times
                    if one.multiplier is None
                    else one.multiplier.at(np.array([lever]))[0]
                )
                for one in test.tables
            ),
            0.0 * grid,
        )
        off = 0.02 * grid + 1.25
        found: dict[str, Any] = {}
        for share in (*shares, *(-each for each in shares)):
            found[f"{share:g}"] = said(
                lambda share=share: verdict(test, grid, off, off + share * moved)
            )
        stays = np.where(np.cumsum(np.abs(moved)) > 0, test.expected_um, 0.0)
        for part in (0.3, 0.45, 0.55, 0.8, 1.5):
            found[f"{part:g} stays"] = said(
                lambda part=part: verdict(
                    test,
                    grid,
                    off,
                    off
                    + moved
                    + part * np.where(np.cumsum(np.abs(moved[::-1]))[::-1] > 0, 0.0, stays),
                )
            )
        found["reversed"] = said(
            lambda: verdict(test, grid[::-1], off[::-1], (off + moved)[::-1])
        )
        found["short"] = said(
            lambda: verdict(test, grid[1:-1], off[1:-1], off[1:-1] + moved[1:-1])
        )
        found["two positions"] = said(
            lambda: verdict(test, grid[[0, -1]], off[[0, -1]], off[[0, -1]])
        )
        return found

    return plain.attempted(act)


def toml(found: Any) -> str:
    return f" | {found.kind} {found.sense}" if found.sense else ""


def said(judge: Callable[[], Any]) -> Any:
    def act() -> Any:
        found = judge()
        return (
            f"{found.kind} {found.sense} {found.moved_um:.4f}: "
            f"{references.plain(found.words)}{toml(found)}"
        )

    return plain.attempted(act)


def cases() -> dict[str, Callable[[], Any]]:
    """Return the sign tests by name."""
    found: dict[str, Callable[[], Any]] = {}
    for control in (
        "siemens",
        "heidenhain",
        "linuxcnc",
        "beckhoff",
        "mitsubishi",
        "fagor",
        "neutral",
    ):
        found[f"bump-{control}-EXX"] = lambda control=control: _bumped(control, "EXX")
        found[f"bump-{control}-EYX"] = lambda control=control: _bumped(control, "EYX")
        shares = SHARES if control == "siemens" else FEW
        found[f"verdict-{control}"] = lambda control=control, shares=shares: _judged(
            control, "EZZ", profile_of(control, steps=FINE), shares
        )
    section = fanuc_section("straightness_option = true", "inclination = true")
    plain_fanuc = lambda: profile_of("fanuc", steps=FINE, files=WIDE)  # noqa: E731 - made when it is asked for
    found["bump-fanuc-EXX"] = lambda: _bumped("fanuc", "EXX", plain_fanuc())
    found["bump-fanuc-inclined"] = lambda: _bumped(
        "fanuc", "EYY", profile_of("fanuc", steps=FINE, files=WIDE, section=section)
    )
    found["bump-fanuc-EYX"] = lambda: _bumped(
        "fanuc", "EYX", profile_of("fanuc", steps=FINE, files=WIDE, section=section)
    )
    found["verdict-fanuc"] = lambda: _judged("fanuc", "EXX", plain_fanuc())
    products = lambda: profile_of("siemens", "products = true", steps=FINE)  # noqa: E731
    for function in ("EYX*Z", "EXX*Y", "EZY*X"):
        found[f"bump-product-{function.replace('*', '-')}"] = lambda function=function: (
            _bumped("siemens", function, products())
        )
    found["verdict-product"] = lambda: _judged("siemens", "EYX*Z", products(), SHARES)
    found["bump-product-none"] = lambda: {
        function: _bumped("siemens", function)
        for function in ("EYX*Z", "EYX*X", "EYX*", "EAX", "EXX*X", "", "EX", "EYX*W")
    }
    chain = lambda: profile_of("beckhoff", 'chain = "FXYZ"', steps=FINE)  # noqa: E731
    found["bump-chain"] = lambda: _bumped("beckhoff", "EYX*Z", chain())
    found["bump-chain-EXZ-Y"] = lambda: _bumped("beckhoff", "EXZ*Y", chain())
    found["verdict-lists"] = lambda: _judged(
        "beckhoff",
        "EYX",
        profile_of("beckhoff", steps=FINE, section=LISTS + 'cross_sense = "as-compensation"'),
    )
    found["verdict-linuxcnc-ramp"] = lambda: _judged(
        "linuxcnc", "EXY", profile_of("linuxcnc", steps=FINE)
    )
    found["verdict-linuxcnc-other-ramp"] = lambda: _judged(
        "linuxcnc", "EZX", profile_of("linuxcnc", steps=FINE)
    )
    found["verdict-absolute"] = lambda: _judged(
        "mitsubishi",
        "EXX",
        profile_of(
            "mitsubishi",
            steps=FINE,
            section='[mitsubishi]\noutput_unit_um = 0.5\ndata = "absolute"',
        ),
    )
    found["undecided"] = _undecided
    found["grids"] = _grids
    found["readings"] = _readings
    return found


def _grids() -> Any:
    """Bumps on grids of any fineness, with the reference anywhere."""
    found = {}
    for step in (5.0, 10.0, 12.5, 25.0, 37.5, 50.0, 60.0, 75.0, 100.0, 150.0):
        for reference in (-200.0, -150.0, -100.0, -50.0, 0.0, 100.0):
            if (reference + 200.0) % step:
                continue
            profile = profile_of(
                "siemens", steps={"X": step}, axis={"X": f"reference_mm = {reference}"}
            )
            made = _bumped("siemens", "EXX", profile, files=False)
            if "refused" not in made:
                made = {
                    "at": [made["top"], made["beyond"], made["expected"]],
                    "um": _runs(made["tables"][0]["um"]),
                }
            found[f"{step:g} mm from {reference:g}"] = made
    return found


def _runs(values: list[float]) -> list[list[float]]:
    """Return values as runs of equal ones."""
    found: list[list[float]] = []
    for value in values:
        if found and found[-1][1] == value:
            found[-1][0] += 1
        else:
            found.append([1, value])
    return found


def _readings() -> Any:
    """Runs from readings: passes that go out and back, of other axes, and such as do not fit."""

    def run(
        axis: int = 0,
        at: tuple[float, ...] = (0.0, 50.0, 100.0),
        add: tuple[float, ...] = (0.0, 0.0, 0.0),
        passes: int = 2,
    ) -> Readings:
        columns: dict[str, Any] = {
            name: []
            for name in (
                "setup",
                "pass_number",
                "stop",
                "position_mm",
                "reading_mm",
                "beam_mm",
                "time_s",
            )
        }
        for number in range(1, passes + 1):
            order = range(len(at)) if number % 2 else range(len(at) - 1, -1, -1)
            for stop, index in enumerate(order):
                place = [5.0, 7.0, -3.0]
                place[axis] += at[index]
                first = at[order[0]]
                columns["setup"].append(f"linear-{'xyz'[axis]}")
                columns["pass_number"].append(number)
                columns["stop"].append(stop)
                columns["position_mm"].append(place)
                columns["reading_mm"].append(at[index] - first + add[index] * 1e-3 * number)
                columns["beam_mm"].append([0.0, 0.0, 0.0])
                columns["time_s"].append(float(len(columns["stop"])))
        return make_readings(**columns, u_um=None, zero=[NO_ZERO] * len(columns["stop"]))

    def of(off: Readings, on: Readings, axis: str) -> Any:
        return plain.attempted(
            lambda: [column.tolist() for column in from_readings(off, on, axis)[:3]]
        )

    return {
        "a bump": of(run(), run(add=(0.0, 4.0, 0.0)), "X"),
        "one pass": of(run(passes=1), run(add=(0.0, 4.0, 1.0), passes=1), "X"),
        "along z": of(run(2), run(2, add=(0.0, -4.0, 0.0)), "Z"),
        "another axis": of(run(1), run(1), "X"),
        "another axis on": of(run(0), run(1), "X"),
        "elsewhere": of(run(), run(at=(0.0, 51.0, 100.0)), "X"),
        "fewer": of(run(), run(at=(0.0, 100.0)), "X"),
        "a micron beside": of(run(), run(at=(0.0, 50.0005, 100.0)), "X"),
    }


def _undecided() -> Any:
    """A test that decided nothing makes no record."""
    profile = profile_of("siemens", steps=FINE)
    test = bump(controller_named("siemens"), profile, "EXX")
    found = verdict(test, np.linspace(-200.0, 100.0, 7), np.zeros(7), np.zeros(7))
    return plain.attempted(
        lambda: record(
            test, found, subject("siemens", profile), date(2026, 5, 4), []
        ).as_toml()
    )
