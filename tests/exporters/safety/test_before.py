"""What a control holds before loading is compared with the machine's own files, on every control
that no loading program guards."""

from dataclasses import replace

import msgspec
import pytest

from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.profiles.registry import controller_named
from stepdiag.exporters.safety.read_back import BEFORE, STEPS, compare_before
from stepdiag.exporters.tables.curves import curves_of
from stepdiag.exporters.tables.profile import Profile
from testkit.exact.machines import profile_of
from testkit.exact.results import VOLUME, made_result

OLD = {"EXX": [0, 3, 1, 0, -2], "EYY": [0, 2, 4, 2, 1], "EZZ": [0, 1, 2, 1, 0]}
"""A table for each axis of any control."""
NAMED = [*BEFORE, "linuxcnc"]


def machine(name: str, *, on: bool = False) -> tuple[Profile, list[ControlFile]]:
    """Return the profile of a control that holds the tables of `OLD`, and its files."""
    control, base = controller_named(name), profile_of(name, VOLUME)
    files = control.render(
        control.plan(curves_of(made_result(OLD), list(OLD)), base).tables, base
    )
    data = [file for file in files if file.role == "data"]
    state = msgspec.structs.replace(base.machine, measured_with="on" if on else "off")
    return replace(base, existing=tuple(data), machine=state), data


def test_every_control_has_a_guard() -> None:
    """A loading program or script, or a step of a person."""
    assert set(STEPS) - set(BEFORE) == {"siemens", "linuxcnc"}


@pytest.mark.parametrize("name", NAMED)
def test_what_is_listed_is_what_is_held(name: str) -> None:
    profile, files = machine(name)
    found = compare_before(controller_named(name), files, profile)
    assert found.findings == ()
    assert found.numbers >= 15


@pytest.mark.parametrize("name", NAMED)
def test_other_contents_are_named_with_their_table(name: str) -> None:
    """The last number of a file is another one, as after an edit in the control."""
    profile, _ = machine(name)
    control = controller_named(name)
    other = made_result(OLD | {"EYY": [0, 2, 4, 5, 1]})
    base = replace(profile, existing=profile_of(name, VOLUME).existing)
    edited = control.render(control.plan(curves_of(other, list(OLD)), base).tables, base)
    held = [file for file in edited if file.role == "data"]
    found = compare_before(control, held, profile)
    assert [each.code for each in found.findings] == ["read-back-differs"] * len(
        found.findings
    )
    assert found.findings
    assert all("EYY" in each.text or "Y" in each.text for each in found.findings)


@pytest.mark.parametrize("name", [name for name in NAMED if name != "fanuc"])
def test_tables_that_nobody_listed_are_found(name: str) -> None:
    """A FANUC punch file is needed as template and is always listed."""
    profile, files = machine(name)
    found = compare_before(controller_named(name), files, replace(profile, existing=()))
    assert {each.key for each in found.findings} == {"read-back-differs.beside"}
