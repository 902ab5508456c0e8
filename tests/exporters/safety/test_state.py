"""Whether the compensation was on while measuring is read from the data, and held against what is
stated."""

from collections import Counter
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from stepdiag.base.compensation import Statement
from stepdiag.base.errors import SafetyError
from stepdiag.base.result.members import Facts
from stepdiag.base.result.result import Result
from stepdiag.exporters.export.export import export
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.state import UNPROVEN, proof_needed, shares, state_findings
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.fit import fitted
from stepdiag.exporters.tables.tables import Table
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result
from testkit.examples import spread

CONTROL = controller_named("siemens")
NAMES = ("EXX", "EYY", "EZZ", "EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ")
KINDS = {"EEC": NAMES[:3], "CEC": NAMES[3:]}
MACHINES = len(spread(range(200), 2))


def drawn(dice: np.random.Generator, size_um: float = 8.0) -> dict[str, np.ndarray]:
    """Draw the functions of a machine: slopes for the positioning errors, bows for the
    straightnesses."""
    along = np.linspace(0.0, 1.0, 5)
    found = {}
    for name in NAMES:
        bow = size_um * dice.normal() * np.sin(
            np.pi * along
        ) + size_um / 2 * dice.normal() * np.sin(2 * np.pi * along)
        found[name] = bow + (size_um * dice.normal() * along if name[1] == name[2] else 0.0)
    return found


def tables_of(errors: dict[str, np.ndarray]) -> tuple[Table, ...]:
    return tuple(
        CONTROL.plan(
            curves_of(made_result({name: list(each) for name, each in errors.items()})),
            profile_of("siemens", VOLUME),
        ).tables
    )


def surveyed(
    dice: np.random.Generator, acted: dict[str, bool]
) -> tuple[Result, tuple[Table, ...]]:
    """Draw a machine with old tables of 0.7 to 1.4 of the right size, a sixth of its errors new,
    and what a survey finds of it."""
    old = drawn(dice)
    sizes = {kind: float(np.exp(dice.uniform(np.log(0.7), np.log(1.4)))) for kind in KINDS}
    kind_of = {name: kind for kind, names in KINDS.items() for name in names}
    now = {
        name: each * (1 + 0.15 * dice.normal())
        - acted[kind_of[name]] * sizes[kind_of[name]] * each
        + 0.5 * dice.normal(size=5)
        for name, each in old.items()
    }
    tables = tables_of({name: sizes[kind_of[name]] * each for name, each in old.items()})
    return made_result(
        {name: list(each - each[0]) for name, each in now.items()}, u_um=0.5
    ), tables


@pytest.mark.parametrize("state", ["on", "off"])
def test_a_wrong_statement_is_found_and_a_right_one_never_refused(state: str) -> None:
    """False alarms below 2 % of 200 machines, 100 in a usual run, whose old tables are anything
    from too small to too large."""
    other = {"on": "off", "off": "on"}[state]
    false, found = 0, 0
    for seed in range(MACHINES):
        result, tables = surveyed(
            np.random.default_rng(seed), dict.fromkeys(KINDS, state == "on")
        )
        false += any(
            each.severity == "error" for each in state_findings(result, tables, state)
        )
        found += any(
            each.severity == "error" for each in state_findings(result, tables, other)
        )
    assert false < 0.02 * MACHINES
    assert found > 0.95 * MACHINES


@pytest.mark.parametrize("state", ["on", "off"])
def test_functions_that_changed_by_themselves_refuse_no_right_statement(state: str) -> None:
    """Three bows of a machine are new since its tables were made: what the others show decides."""
    other = {"on": "off", "off": "on"}[state]
    false, found = 0, 0
    for seed in range(MACHINES):
        dice = np.random.default_rng(seed)
        result, tables = surveyed(dice, dict.fromkeys(KINDS, state == "on"))
        errors = dict(result.errors)
        for name in dice.choice(NAMES, 3, replace=False).tolist():
            value = errors[name].value
            assert value is not None
            errors[name] = replace(
                errors[name],
                value=value + 8.0 * dice.normal() * np.sin(np.linspace(0.0, np.pi, 5)),
            )
        changed = replace(result, errors=errors)
        false += any(
            each.severity == "error" for each in state_findings(changed, tables, state)
        )
        found += any(
            each.severity == "error" for each in state_findings(changed, tables, other)
        )
    assert false < 0.02 * MACHINES
    assert found > 0.8 * MACHINES


@pytest.mark.parametrize("state", ["on", "off"])
def test_tables_of_another_machine_refuse_no_right_statement(state: str) -> None:
    """Their shares may look like any state; what is left beside them does not. By the shares alone
    9 of 60 were refused (off)."""
    refused = 0
    for seed in range(60):
        dice = np.random.default_rng((5, seed))
        own, other = drawn(dice), drawn(dice)
        now = {
            name: each - (state == "on") * other[name] + 0.5 * dice.normal(size=5)
            for name, each in own.items()
        }
        result = made_result(
            {name: list(each - each[0]) for name, each in now.items()}, u_um=0.5
        )
        refused += any(
            each.severity == "error"
            for each in state_findings(result, tables_of(other), state)
        )
    assert refused <= 1


@pytest.mark.parametrize("left_on", list(KINDS))
def test_one_forgotten_switch_shows_with_the_functions_of_its_tables(left_on: str) -> None:
    named, wrong = 0, 0
    for seed in range(50):
        result, tables = surveyed(
            np.random.default_rng(seed), {kind: kind == left_on for kind in KINDS}
        )
        found = [
            set(each.message.arguments["names"])
            for each in state_findings(result, tables, "off")
            if each.severity == "error"
        ]  # type: ignore[union-attr]
        named += any(names <= {*KINDS[left_on], "C0Y", "B0Z", "A0Z"} for names in found)
        wrong += any(
            names & set(KINDS[other])
            for names in found
            for other in KINDS
            if other != left_on
        )
    assert named >= 43
    assert wrong <= 1


@pytest.mark.parametrize(("stated", "acted"), [("on", True), ("off", False)])
def test_one_table_in_the_other_state_is_asked_about_by_its_name(
    stated: str, acted: bool
) -> None:
    """Its own switch, or its own weight, was forgotten: the mean of its kind does not show it, the
    table itself does.

    Of 60 machines with one such table 54 or more name it or call for a proof run; of 60 without one
    none asks.
    """
    named, false = 0, 0
    for seed in range(60):
        dice = np.random.default_rng(seed)
        old, odd = drawn(dice), KINDS["CEC"][seed % 6]
        size = float(np.exp(dice.uniform(np.log(0.7), np.log(1.4))))
        now = {
            name: error * (1 + 0.15 * dice.normal())
            - (acted != (name == odd)) * size * error
            + 0.5 * dice.normal(size=5)
            for name, error in old.items()
        }
        result = made_result(
            {name: list(error - error[0]) for name, error in now.items()}, u_um=0.5
        )
        found = list(
            state_findings(
                result, tables_of({name: size * error for name, error in old.items()}), stated
            )
        )
        assert all(each.severity == "warning" for each in found)
        named += any(
            each.key == UNPROVEN
            or (
                each.key == "compensation-contradicted.one"
                and odd in each.message.arguments["names"]
            )
            for each in found
        )  # type: ignore[union-attr]
        result, tables = surveyed(np.random.default_rng(seed), dict.fromkeys(KINDS, acted))
        false += any(each.key != UNPROVEN for each in state_findings(result, tables, stated))
    assert named >= 54
    assert false == 0


def ends(size: float, *, acted: bool, stated: str, of: int) -> Counter[str]:
    """Count what is made of a statement about tables of one size: refused, asked, a proof run,
    shown."""
    counted: Counter[str] = Counter()
    for seed in range(of):
        dice = np.random.default_rng((9, seed))
        old = drawn(dice)
        sized = size if size > 0.0 else float(np.exp(dice.uniform(np.log(0.7), np.log(1.4))))
        now = {
            name: error * (1 + 0.15 * dice.normal())
            - acted * sized * error
            + 0.5 * dice.normal(size=5)
            for name, error in old.items()
        }
        result = made_result(
            {name: list(each - each[0]) for name, each in now.items()}, u_um=0.5
        )
        tables = tables_of({name: sized * error for name, error in old.items()})
        found = list(state_findings(result, tables, stated))
        assert proof_needed(found) == bool(found)
        worst = "refused" if any(each.severity == "error" for each in found) else "asked"
        only = bool(found) and all(each.key == UNPROVEN for each in found)
        counted["proof" if only else worst if found else "shown"] += 1
    return counted


ORDINARY = 0.0


@pytest.mark.parametrize("state", ["on", "off"])
def test_right_statements_about_ordinary_tables_are_seldom_asked_about(state: str) -> None:
    """Of 200 machines, 100 in a usual run, none is refused, fewer than 2 % are asked, and fewer
    than a quarter need a proof run."""
    counted = ends(ORDINARY, acted=state == "on", stated=state, of=MACHINES)
    assert counted["refused"] == 0
    assert counted["asked"] < 0.02 * MACHINES
    assert counted["proof"] < MACHINES / 4


@pytest.mark.parametrize(
    ("size", "acted", "stated"),
    [(0.6, True, "off"), (0.7, True, "off"), (2.0, False, "on"), (1.7, False, "on")],
)
def test_what_would_make_the_machine_worse_is_no_promise(size, acted, stated) -> None:
    """Tables of another size look like right ones in the other state: at most 2 of 100 are quiet.

    A table of 0.6 leaves 0.4 of the error; taken for one that was off, it becomes 0.6.
    """
    assert ends(size, acted=acted, stated=stated, of=100)["shown"] <= 2


def test_half_size_tables_that_act_are_seen_or_do_no_harm() -> None:
    """Half of the error remains, as it was: the share is that of right tables that are off, and no
    evidence tells them apart. Two thirds are asked about or need a proof run all the same."""
    counted = ends(0.5, acted=True, stated="off", of=100)
    assert counted["asked"] + counted["proof"] >= 50


def test_a_table_smaller_than_what_the_survey_knows_says_nothing() -> None:
    dice = np.random.default_rng(1)
    small = {name: 0.02 * each for name, each in drawn(dice).items()}
    result = made_result(
        {name: list(each - each[0]) for name, each in drawn(dice).items()}, u_um=0.5
    )
    assert shares(result, tables_of(small)) == []


@pytest.mark.parametrize(("acted", "stated"), [(True, "off"), (False, "on")])
def test_an_export_on_a_wrong_statement_is_refused(
    acted: bool, stated: str, tmp_path
) -> None:
    """Tables made of what is left, in place of the old ones: 2.8 µm had become 5.1 with exit code
    0."""
    result, _ = surveyed(np.random.default_rng(3), dict.fromkeys(KINDS, acted))
    dice = np.random.default_rng(3)
    plan = CONTROL.plan(
        curves_of(made_result({name: list(each) for name, each in drawn(dice).items()})),
        profile_of("siemens", VOLUME),
    )
    existing = tuple(
        file
        for file in CONTROL.render(plan.tables, profile_of("siemens", VOLUME))
        if file.name.endswith(".INI")
    )
    base = profile_of("siemens", VOLUME)
    profile = replace(
        base,
        existing=existing,
        machine=msgspec.structs.replace(base.machine, measured_with=stated),
    )
    statement = Statement(state="off") if stated == "off" else _on(existing)
    with pytest.raises(SafetyError) as refused:
        export(
            replace(result, survey=statement.facts(Facts(machine="test machine"))),
            "siemens",
            profile,
            accept=("change-large", "correction-small.uncertainty"),
            out_dir=tmp_path / "out",
        )
    assert "compensation-contradicted" in (refused.value.code, *str(refused.value).split())
    assert not (tmp_path / "out").exists()


def _on(existing):
    from datetime import date

    from stepdiag.base.compensation import stated

    return stated(
        "on", {file.name: file.data for file in existing}, date(2026, 6, 1), "archive"
    )


def test_a_control_with_one_slope_a_pair_is_compared_with_the_lines_of_both_functions() -> (
    None
):
    """The coefficients of matrixkins hold the best lines of two bows beside the squareness: off,
    the survey finds all of them, whatever the bows are."""
    linuxcnc, dice = controller_named("linuxcnc"), np.random.default_rng(4)
    for _ in range(20):
        old = {
            name: list(each - np.linspace(each[0], each[-1], 5))
            if name[1] != name[2]
            else each
            for name, each in drawn(dice).items()
        }
        square = {
            name: float(each)
            for name, each in zip(
                ("C0Y", "B0Z", "A0Z"), 20 * dice.normal(size=3), strict=True
            )
        }
        result = made_result(old, squareness=square, u_um=0.05)
        fit = fitted(result)
        tables = linuxcnc.plan(fit.curves, profile_of("linuxcnc", VOLUME)).tables
        found = {
            share.name: share.value
            for share in shares(result, tables)
            if share.name in square
        }
        assert found
        assert all(abs(value - 1.0) < 0.02 for value in found.values()), found
