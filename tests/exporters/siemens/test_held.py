"""A loading program writes only over what the export takes for held: on a control that shares no
code with it."""

from dataclasses import replace

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.tables.curves import curves_of
from testkit.exact.hasty import MACHINE_DATA
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result
from testkit.exact.sinumerik import Sinumerik
from testkit.examples import few

SIEMENS = controller_named("siemens")
OLD, NEW = (
    {"EXX": [0, 3, 1, 0, -2], "EYX": [0, 1, 2, 1, 0]},
    {"EXX": [0, 4, 2, 0, -5], "EYX": [0, 2, -2, 1, 0]},
)
POINTS = [
    name.format(point)
    for name in ("$AA_ENC_COMP[0,{},AX1]", "$AN_CEC[0,{}]")
    for point in range(7)
]


def rendered(errors, existing=(), stated="off"):
    base = profile_of("siemens", VOLUME)
    profile = replace(
        base,
        existing=existing,
        machine=msgspec.structs.replace(base.machine, measured_with=stated),
    )
    return SIEMENS.render(
        SIEMENS.plan(curves_of(made_result(errors), list(errors)), profile).tables, profile
    )


def data_of(files) -> tuple[ControlFile, ...]:
    return tuple(file for file in files if file.name.endswith(".INI"))


def loaded(control: Sinumerik, files) -> list[bool]:
    """Load files; return for each program whether it refused."""
    refused = []
    for file in files:
        if file.name.startswith("LOAD"):
            control.shown.clear()
            control.run(file.data.decode())
            refused.append(control.refused)
    return refused


def control_with_old() -> tuple[Sinumerik, tuple[ControlFile, ...]]:
    control, old = Sinumerik(machine=MACHINE_DATA), rendered(OLD)
    assert loaded(control, old) == [False, False]
    return control, data_of(old)


def test_what_is_listed_is_written_over_and_again() -> None:
    control, old = control_with_old()
    new = rendered(NEW, old, "on")
    assert loaded(control, new) == loaded(control, new) == [False, False]
    assert control.held["$AA_ENC_COMP[0,1,AX1]"] != "0.0000"


@pytest.mark.parametrize("listed", ["nothing", "EEC", "CEC"])
def test_what_nobody_listed_is_not_written_over(listed) -> None:
    control, old = control_with_old()
    before = dict(control.held)
    refused = loaded(
        control, rendered(NEW, tuple(file for file in old if listed in file.name))
    )
    assert refused == [listed != "EEC", listed != "CEC"]
    assert any(
        control.held[name] == before[name]
        for name in POINTS
        if before.get(name, "0.0000") != "0.0000"
    )


@few(30)
@given(st.sampled_from(POINTS), st.sampled_from([1e-3, -1e-3, 0.02]))
def test_one_other_number_anywhere_stops_the_program(place, by_mm) -> None:
    """Also above the points of the table, where an old one may be longer."""
    control, old = control_with_old()
    control.held[place] = f"{float(control.held.get(place, '0')) + by_mm:.4f}"
    before = dict(control.held)
    assert loaded(control, rendered(NEW, old)) == ["AA_ENC" in place, "AN_CEC" in place]
    assert control.held[place] == before[place]


@pytest.mark.parametrize(
    ("name", "value", "refused"),
    [
        ("$SN_CEC_TABLE_WEIGHT[0]", "0.5", [False, True]),
        ("$SN_CEC_TABLE_ENABLE[0]", "0", [False, True]),
        ("$MA_ENC_COMP_ENABLE[0,AX1]", "0", [True, False]),
    ],
)
def test_tables_stated_to_have_acted_that_do_not_act_stop_it(name, value, refused) -> None:
    for stated, stops in (("on", refused), ("off", [False, False])):
        control, old = control_with_old()
        control.held[name] = value
        assert loaded(control, rendered(NEW, old, stated)) == stops
