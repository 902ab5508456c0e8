"""Restore files of a SINUMERIK: the machine's own tables, and switched-off tables of zeros for new
tables that the machine did not have.

Loading the old files does not remove a new table: it would stay active beside the old tables. So
the restore files contain every table that an export writes. The restore files are data files (the
machine's own bytes, and a file of zeros) and part programs with the checks of
`stepdiag.exporters.siemens.loader`. The part programs also switch off the tables that the machine
did not have.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

from stepdiag.base.errors import SafetyError, UsageError
from stepdiag.base.messages import Message, message
from stepdiag.exporters.files.control_file import ControlFile
from stepdiag.exporters.siemens import cec, eec, loader, products
from stepdiag.exporters.siemens.ini import (
    Assignment,
    data_file,
    is_program,
    read_assignments,
    switches_in,
)
from stepdiag.exporters.siemens.loader import Load
from stepdiag.exporters.tables.own_files import NO_TABLE_BEFORE
from stepdiag.exporters.tables.profile import Profile
from stepdiag.exporters.tables.tables import Sense, Table, zeroed

_NOTES = (NO_TABLE_BEFORE,)
OFF = ("0", "FALSE")
"""Texts of a switch that is off."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """The restore data of EEC or CEC: prefix of the variables, name of the data file, loading
    program, the machine's own tables, and zeros for tables that the machine did not have.
    """

    prefix: str
    data_name: str
    program: Callable[[Sequence[Load]], ControlFile]
    own: tuple[Load, ...]
    zeros: tuple[Load, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Old:
    """Switches and weights of the machine's own tables before an export was loaded: from the own
    files, or else from the profile.
    """

    profile: Profile
    enabled: bool | None
    weight: float | None

    def load(
        self, table: Table, lines: Sequence[str], switches: Sequence[str], weight: str = ""
    ) -> Load:
        """Return a table in its earlier state: on if all its ``switches`` were on.

        Raises ``SafetyError`` (``profile-incomplete.switches``) if neither files nor profile state
        the switches, ``UsageError`` for an active table with a weight other than 1.
        """
        held = switches_in(self.profile.existing)
        values = [held[name] for name in switches if name in held]
        off, known = any(value in OFF for value in values), len(values) == len(switches)
        acted = self.profile.machine.measured_with == "on" and self.enabled is None
        active = not off and (
            known
            or acted
            or self._stated(
                table, self.enabled, "old_enabled", message("whether-switched-on")
            )
        )
        weighs = 1.0
        if weight:
            stated = held.get(weight)
            weighs = (
                float(stated)
                if stated is not None
                else self._stated(table, self.weight, "old_weight", message("its-weight"))
            )
        if self.profile.machine.measured_with == "on" and active and weighs != 1.0:
            expected = message("weight-1-tables-acted")
            raise UsageError(
                f"{self.profile.source}: siemens.old_weight",
                expected=expected,
                found=message("weight-of-table", weighs=weighs, label=table.label),
            )
        return Load(table=table, lines=lines, active=bool(active), weight=weighs)

    def _stated(self, table: Table, value: float | None, key: str, what: Message) -> float:
        if value is None and table.value_um.any():
            raise SafetyError(
                f"{self.profile.source}: siemens.{key}",
                code="profile-incomplete.switches",
                expected=message("for-which-control-holds", label=table.label, what=what),
                found=message("nothing"),
                remedy=message("read-it-in-control"),
            )
        return 0.0 if value is None else value


def restore_files(
    kinds: Sequence[Kind], profile: Profile, *, metric_line: bool
) -> tuple[ControlFile, ...]:
    """Return the machine's own files, the files of zeros, and the part programs that load both;
    ``kinds`` are the kinds of table that an export writes.
    """
    files = list(profile.existing)
    for kind in kinds:
        made = [_zero_file(files, kind, metric_line=metric_line)] if kind.zeros else []
        for file in (*made, kind.program((*kind.own, *kind.zeros))):
            files.append(replace(file, name=_free_name(file.name, files)))
    return tuple(files)


def eec_kind(tables: Sequence[Table], profile: Profile, decimals: int, old: Old) -> Kind:
    own = {
        _eec_place(table): table
        for file in profile.existing
        for table in eec.read_tables(file, profile)
    }
    lines = _lines_by_place(profile.existing, "AA_ENC_COMP", _eec_index)
    return Kind(
        prefix="AA_ENC_COMP",
        data_name="AX_EEC",
        program=lambda loads: loader.eec_program(loads, _NOTES),
        own=tuple(
            old.load(table, lines[place], (f"MA_ENC_COMP_ENABLE[{place}]",))
            for place, table in own.items()
        ),
        zeros=tuple(
            Load(table=table, lines=eec.assignments(table, decimals, 0), active=False)
            for table in zeroed(tables)
            if _eec_place(table) not in own
        ),
    )


def cec_kind(
    tables: Sequence[Table], profile: Profile, decimals: int, old: Old, *, sense: Sense
) -> Kind:
    own = {
        _cec_place(table): table
        for file in profile.existing
        for table in cec.read_tables(file, profile, sense)
    }
    lines = _lines_by_place(profile.existing, "AN_CEC", lambda index: index[0])
    return Kind(
        prefix="AN_CEC",
        data_name="NC_CEC",
        program=lambda loads: loader.cec_program(loads, profile, _NOTES),
        own=tuple(
            old.load(
                table,
                lines[place],
                (
                    f"SN_CEC_TABLE_ENABLE[{place}]",
                    f"MA_CEC_ENABLE[{profile.axis(table.output_axis).name}]",
                ),
                f"SN_CEC_TABLE_WEIGHT[{place}]",
            )
            for place, table in own.items()
        ),
        zeros=tuple(
            Load(
                table=table, lines=cec.assignments(table, profile, decimals, 0), active=False
            )
            for table in products.numbered(zeroed(tables))
            if _cec_place(table) not in own
        ),
    )


def is_idle(table: Table, profile: Profile, enabled: Collection[str] = ()) -> bool:
    """Return whether a table is switched off in the machine's own files although compensation was
    active during the measurement. The CEC of the axes ``enabled`` is assumed to be switched on.
    """
    if profile.machine.measured_with == "off":
        return False
    if table.kind == eec.KIND:
        switches = [f"MA_ENC_COMP_ENABLE[{_eec_place(table)}]"]
    else:
        switches = [f"SN_CEC_TABLE_ENABLE[{_cec_place(table)}]"]
        if table.output_axis not in enabled:
            switches.append(f"MA_CEC_ENABLE[{profile.axis(table.output_axis).name}]")
    held = switches_in(profile.existing)
    return any(held.get(name) in OFF for name in switches)


def held_lines(profile: Profile) -> Callable[[Table], list[str]]:
    """Return a function from a table to its assignments in the machine's own files, under the same
    number or axis; empty without such assignments.
    """
    eec_lines = _lines_by_place(profile.existing, "AA_ENC_COMP", _eec_index)
    cec_lines = _lines_by_place(profile.existing, "AN_CEC", lambda index: index[0])

    def held(table: Table) -> list[str]:
        if table.kind == eec.KIND:
            return eec_lines.get(_eec_place(table), [])
        return cec_lines.get(_cec_place(table), [])

    return held


def _eec_place(table: Table) -> str:
    return f"{int(table.place['measuring system']) - 1},{table.place['axis']}"


def _eec_index(index: tuple[str, ...]) -> str:
    return f"{index[0]},{index[-1]}"


def _cec_place(table: Table) -> str:
    return str(table.place["table"])


def _lines_by_place(
    files: Sequence[ControlFile], prefix: str, place_of: Callable[[tuple[str, ...]], str]
) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for file in files:
        here: dict[str, list[Assignment]] = {}
        for item in read_assignments(file):
            if item.name.startswith(prefix):
                here.setdefault(place_of(item.index), []).append(item)
        for place, items in here.items():
            found.setdefault(
                place,
                [item.text() for item in sorted(items, key=lambda item: item.name != prefix)],
            )
    return found


def _zero_file(files: Sequence[ControlFile], kind: Kind, *, metric_line: bool) -> ControlFile:
    beside_own = any(
        not is_program(file) and f"${kind.prefix}".encode() in file.data for file in files
    )
    lines = [load.lines for load in kind.zeros]
    return data_file(
        f"{kind.data_name}_ZERO" if beside_own else kind.data_name,
        lines,
        _NOTES,
        metric_line=metric_line,
    )


def _free_name(name: str, files: Sequence[ControlFile]) -> str:
    taken = {file.name.upper() for file in files}
    return next(each for each in _names(name) if each.upper() not in taken)


def _names(name: str) -> Iterator[str]:
    yield name
    number = 2
    while True:
        stem, _, ending = name.rpartition(".")
        yield f"{stem}_{number}.{ending}"
        number += 1
