"""The section ``[program]`` of a profile: settings of NC programs in which a machine differs from
the control's defaults.

``stepdiag program`` reads only this section, so the profile may still contain unanswered questions
about tables.
"""

import json
from dataclasses import fields, replace
from typing import Annotated

import msgspec

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.base.settings import convert, read_toml, refuse
from stepdiag.exporters.programs.signals import Signals

SECTION = "program"
_TEXTS = tuple(item.name for item in fields(Signals))

TEMPLATE = """\

# only for `stepdiag program`; a setting that is left out has the default of the control
# [program]
# decimals = {decimals}                # decimal places of the control's input increment in mm
# Blocks that send the setup and the count of stops to the PLC. The program replaces {{setup}} and
# {{count}} by numbers; \\n begins the next block.
"""


class ProgramSection(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    decimals: Annotated[int, msgspec.Meta(ge=0, le=6)] | None = None
    begin: str | None = None
    stand: str | None = None
    leave: str | None = None
    wait: str | None = None
    end: str | None = None

    def signals(self, defaults: Signals) -> Signals:
        """Return the texts of the machine. A text that the section does not contain comes from the
        control's ``defaults``.
        """
        own = {
            name: getattr(self, name) for name in _TEXTS if getattr(self, name) is not None
        }
        return replace(defaults, **own)


class _Travel(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    travel_mm: tuple[float, float]


def program_section(text: str, source: str, control: str) -> ProgramSection:
    """Return the section ``[program]`` in the TOML text of a profile; a missing section means the
    defaults.

    Raises ``UsageError`` for a wrong field, and for a profile of another control.
    """
    tables = read_toml(text, source)
    machine = tables.get("machine", {})
    named = machine.get("controller", control) if isinstance(machine, dict) else control
    if named != control:
        raise UsageError(
            f"{source}: machine.controller",
            expected=control,
            found=repr(named),
            remedy=message("name-profile-this-control"),
        )
    return convert(tables.get(SECTION, {}), ProgramSection, source, SECTION)


def travel_in(text: str, source: str) -> dict[str, tuple[float, float]]:
    """Return the software limits of the axes (x, y, z) that a profile states as ``travel_mm``.
    Raises ``UsageError`` for a wrong value.
    """
    axes = read_toml(text, source).get("axes", {})
    found = {}
    for letter, axis in axes.items() if isinstance(axes, dict) else ():
        if isinstance(axis, dict) and "travel_mm" in axis:
            travel = convert(
                {"travel_mm": axis["travel_mm"]}, _Travel, source, f"axes.{letter}"
            ).travel_mm
            if travel[0] >= travel[1]:
                raise refuse(
                    source,
                    f"axes.{letter}.travel_mm",
                    message("lower-end-first"),
                    list(travel),
                )
            found[letter.lower()] = travel
    return found


def program_template(defaults: Signals, decimals: int) -> str:
    """Return the section ``[program]`` as commented TOML that shows the control's defaults."""
    lines = [f"# {name} = {json.dumps(getattr(defaults, name))}" for name in _TEXTS]
    return TEMPLATE.format(decimals=decimals) + "\n".join(lines) + "\n"
