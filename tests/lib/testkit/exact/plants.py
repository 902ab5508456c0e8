"""Controls as a machine has them: they keep what was loaded until something is loaded over it, by
laws of their own."""

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stepdiag.exporters.files.naming import is_restore, plain_name
from stepdiag.virtual.control.axis_table import AxisTable
from stepdiag.virtual.control.beckhoff import load_volumetric
from stepdiag.virtual.control.fanuc import load_fanuc
from stepdiag.virtual.control.heidenhain import load_tables
from stepdiag.virtual.control.lattice import load_lattice
from stepdiag.virtual.control.linuxcnc import load_matrix, load_screw_file
from stepdiag.virtual.control.siemens import SiemensControl
from testkit.exact.machines import new_punch_file
from testkit.linuxcnc.ini import changed

NAMES = {"AX1": "X", "AX2": "Y", "AX3": "Z"}
Array = np.ndarray


class Plant(ABC):
    """One control with its memory. ``reference_mm`` is where the axes are referenced, ``chain`` how
    they are built."""

    def __init__(self, chain: str, reference_mm: tuple[float, float, float]) -> None:
        self.chain, self.reference_mm = chain, np.array(reference_mm)
        self.texts: dict[str, str] = {}
        self.backlash_um = np.zeros(3)
        """The control's own parameter, as somebody entered it: half of it is added in +, half taken
        off in -, once an axis has turned."""

    def load(self, folder: Path, *, restore: bool = False) -> None:
        """Copy the files of an export over those of the same name, the restore files where
        wanted."""
        for path in sorted(folder.iterdir()):
            if is_restore(path.name) == restore and path.name not in (
                "EXPORT_REPORT.txt",
                "SHA256SUMS",
            ):
                self.take(plain_name(path.name), path.read_bytes().decode("ascii"))

    def take(self, name: str, text: str) -> None:
        """Take one file over."""
        self.texts[name] = text

    def own(self) -> dict[str, bytes]:
        """Return what is read out of the control."""
        return {name: text.encode("ascii") for name, text in self.texts.items()}

    def moved_um(self, points_mm: Array, way: int = 0) -> Array:
        """Return what the tables add at points in um, for travel of all axes in +1 or -1, or the
        mean of both."""
        travel = np.full(points_mm.shape, float(way))
        return 1e3 * sum(
            (table.correction_mm(points_mm, travel) for table in self.tables()), 0.0 * travel
        )

    def turned_um(self, points_mm: Array, *, tables: bool) -> Array:
        """Return what the control makes in + more than in -: by its parameter, and by its tables
        where they act."""
        acts = np.array([not (tables and self.ends_backlash(axis)) for axis in range(3)])
        by_tables = (
            self.moved_um(points_mm, 1) - self.moved_um(points_mm, -1)
            if tables
            else np.zeros(points_mm.shape)
        )
        return by_tables + acts * self.backlash_um

    def ends_backlash(self, axis: int) -> bool:
        """Tell whether a table of this axis keeps the control from looking at its backlash
        parameter."""
        return False

    def steps_um(self, points_mm: Array) -> Array:
        """Return what of that are steps of the control, beside the straight lines through its
        points."""
        return np.zeros(points_mm.shape)

    @abstractmethod
    def tables(self) -> list:
        """Return what acts."""


class SiemensPlant(Plant):
    def __init__(self, chain: str, reference_mm: tuple[float, float, float]) -> None:
        super().__init__(chain, reference_mm)
        self.control = SiemensControl()

    def take(self, name: str, text: str) -> None:
        if name.endswith(".MPF"):
            self.control.load(text)

    def own(self) -> dict[str, bytes]:
        """Return a backup: every variable of the tables, as far as their grids reach."""
        cells = self.control._memory.cells
        lines = [
            f"${name}[{','.join(index)}]={value}"
            for name, held in cells.items()
            for index, value in held.items()
            if name.startswith(("AA_ENC_COMP", "AN_CEC"))
            and "POINT" not in index
            and self._inside(name, index)
        ]
        return (
            {"BACKUP.INI": "\n".join(["CHANDATA(1)", *lines, "M17", ""]).encode("ascii")}
            if lines
            else {}
        )

    def _inside(self, name: str, index: tuple[str, ...]) -> bool:
        if name not in ("AA_ENC_COMP", "AN_CEC"):
            return True
        place, number = (
            ((index[0], index[2]), index[1])
            if name == "AA_ENC_COMP"
            else ((index[0],), index[1])
        )
        low, high, step = (
            float(self.control._memory.cells[f"{name}_{part}"][place])
            for part in ("MIN", "MAX", "STEP")
        )
        return int(number) <= round((high - low) / step)

    def tables(self) -> list:
        return self.control.tables()


class FanucPlant(Plant):
    def __init__(self, chain: str, reference_mm: tuple[float, float, float]) -> None:
        super().__init__(chain, reference_mm)
        sets = b"".join(
            b"N0%dQ1P0\n\r\r" % number
            for first in range(3)
            for number in (
                5711 + first,
                5721 + first,
                *(base + 10 * first + point for base in (5731, 5761) for point in range(4)),
            )
        )
        self.texts["PITCH.TXT"] = (
            new_punch_file().replace(b"N10000", sets + b"N10000", 1).decode("ascii")
        )

    def moved_um(self, points_mm: Array, way: int = 0) -> Array:
        return super().moved_um(points_mm - self.reference_mm, way)

    def steps_um(self, points_mm: Array) -> Array:
        at, still = points_mm - self.reference_mm, np.zeros(points_mm.shape)
        smooth = load_fanuc([self.texts["PITCH.TXT"]], interpolated=True)
        return self.moved_um(points_mm) - 1e3 * sum(
            (table.correction_mm(at, still) for table in smooth), still
        )

    def tables(self) -> list:
        return load_fanuc([self.texts["PITCH.TXT"]])


class HeidenhainPlant(Plant):
    """The rows of the kinematics table go in and out by hand, as the steps of the report say."""

    def load(self, folder: Path, *, restore: bool = False) -> None:
        rows = "kinematics_comp_lines.txt"
        then = self.rows_before if restore else self.texts.get(rows)
        super().load(folder, restore=restore)
        if restore:
            self.texts = {name: text for name, text in self.texts.items() if name != rows} | (
                {rows: then} if then else {}
            )
        else:
            self.rows_before = then

    def own(self) -> dict[str, bytes]:
        return {
            name: data for name, data in super().own().items() if not name.endswith(".txt")
        }

    def tables(self) -> list:
        if "CONFIG.CMA" not in self.texts:
            return []
        heading, row = self.texts["CONFIG.CMA"].splitlines()[1:3]
        starts = [(found.group(), found.start()) for found in re.finditer(r"\S+", heading)]
        cells = {name: row[start : start + 16].strip() for name, start in starts}
        tables = {axis: self.texts[cells[axis]] for axis in NAMES if cells.get(axis)}
        return [
            load_tables(
                tables, self.texts.get("kinematics_comp_lines.txt", ""), axis_names=NAMES
            )
        ]


class BeckhoffPlant(Plant):
    def own(self) -> dict[str, bytes]:
        return {
            name: data for name, data in super().own().items() if not name.endswith(".txt")
        }

    def tables(self) -> list:
        found: list = [
            load_volumetric(text, chain=self.chain)
            for name, text in self.texts.items()
            if name.endswith(".csv")
        ]
        return found + [
            table
            for name, text in self.texts.items()
            if name.endswith(".lis")
            for table in _of_list(text)
        ]


def _of_list(text: str) -> Iterator[AxisTable]:
    """Yield ssfk and crosscomp of an axis list, both as error, in 0.1 µm at 0.1 um."""
    values = {
        cells[0]: cells[1] for line in text.splitlines() if len(cells := line.split()) == 2
    }
    axis = int(values["kopf.achs_nr"]) - 1
    for group, count, into, columns in (
        ("kw.ssfk", int(values.get("kw.ssfk.kw_nr_max", 0)), axis, ("pos", "neg")),
        (
            "kw.crosscomp",
            int(values.get("kw.crosscomp.last_index", -1)) + 1,
            int(values.get("kw.crosscomp.slave_ax_nr", 1)) - 1,
            ("correction",),
        ),
    ):
        for column in columns:
            if f"{group}.table[0].{column}" in values:
                both = column == "correction" or f"{group}.table[0].neg" not in values
                rows = [f"{group}.table[{index}]" for index in range(count)]
                yield AxisTable(
                    input_axis=into,
                    output_axis=axis,
                    position_mm=tuple(int(values[f"{row}.setpoint"]) * 1e-4 for row in rows),
                    value_mm=tuple(-int(values[f"{row}.{column}"]) * 1e-4 for row in rows),
                    travel=0 if both else 1 if column == "pos" else -1,
                )


class LinuxCncPlant(Plant):
    def __init__(self, chain: str, reference_mm: tuple[float, float, float]) -> None:
        super().__init__(chain, reference_mm)
        self.ini: dict[str, list[str]] = {
            "[KINS]": ["KINEMATICS = trivkins coordinates=XYZ"],
            "[HAL]": ["HALFILE = mill.hal"],
        }

    def take(self, name: str, text: str) -> None:
        if name == "ini_lines.txt":
            self.ini = changed(self.ini, text)
        else:
            super().take(name, text)

    def _named(self) -> list[str]:
        lines = [line for section in self.ini.values() for line in section]
        words = [
            line.split(" = ", 1)[1]
            for line in lines
            if line.startswith(("COMP_FILE =", "HALFILE"))
        ]
        lattices = [
            found[1]
            for line in lines
            if (found := re.search(r"stepdiagkins .*lattice=(\S+)", line))
        ]
        return [
            name
            for name in dict.fromkeys([*words, *lattices])
            if name in self.texts and name != "stepdiagkins.hal"
        ]

    def ends_backlash(self, axis: int) -> bool:
        return any(
            f"COMP_FILE = screw_{'xyz'[axis]}.comp" == line
            for lines in self.ini.values()
            for line in lines
        )

    def own(self) -> dict[str, bytes]:
        return {name: self.texts[name].encode("ascii") for name in self._named()}

    def tables(self) -> list:
        found: list = []
        for name in self._named():
            text = self.texts[name]
            if name.endswith(".csv"):
                found.append(load_lattice(text))
            else:
                found += (
                    load_matrix(text)
                    if name.endswith(".hal")
                    else load_screw_file(text, "xyz".index(name[-6]))
                )
        return found


class MitsubishiPlant(Plant):
    """Parameters by number; data as increments of 0.5 µm times the scale, added in +: above the
    reference n holds the section below it."""

    def __init__(self, chain: str, reference_mm: tuple[float, float, float]) -> None:
        super().__init__(chain, reference_mm)
        self.numbers: dict[int, str] = {}

    def take(self, name: str, text: str) -> None:
        if name.startswith(("mitsubishi_parameters", "own")):
            self.numbers |= {
                int(cells[0][1:]): cells[1]
                for line in text.splitlines()
                if line.startswith("#")
                for cells in [line.split()]
            }

    def own(self) -> dict[str, bytes]:
        lines = [f"#{number} {value}" for number, value in sorted(self.numbers.items())]
        return {"own.txt": "\r\n".join([*lines, ""]).encode("ascii")} if lines else {}

    def tables(self) -> list:
        return [
            self._pair(base) for base in range(4000, 4100, 10) if base + 1 in self.numbers
        ]

    def _pair(self, base: int) -> AxisTable:
        into, onto = ("XYZ".index(NAMES[self.numbers[base + number]]) for number in (1, 2))
        reference, first, last, scale = (
            int(self.numbers[base + number]) for number in (3, 4, 5, 6)
        )
        data = {number: int(self.numbers[number]) for number in range(first, last + 1)}
        at = {
            number: sum(data[n] for n in range(reference + 1, number + 1))
            for number in range(reference, last + 1)
        }
        at |= {
            number: -sum(data[n] for n in range(number, reference))
            for number in range(first, reference)
        }
        step = float(self.numbers[base + 7])
        return AxisTable(
            input_axis=into,
            output_axis=onto,
            position_mm=tuple(
                self.reference_mm[into] + (number - reference) * step
                for number in range(first, last + 1)
            ),
            value_mm=tuple(at[number] * 0.5e-3 * scale for number in range(first, last + 1)),
        )


class FagorPlant(Plant):
    def tables(self) -> list:
        return [table for text in self.texts.values() for table in self._list(text)]

    def _list(self, text: str) -> Iterator[AxisTable]:
        lines = [line for line in text.splitlines() if line and not line.startswith(";")]
        axis = "XYZ".index(NAMES[lines[0].split()[1]])
        position, forward, reverse = np.array(
            [[float(cell) for cell in line.split(";")] for line in lines[2:]]
        ).T
        for travel, error in ((1, forward), (-1, reverse if reverse.any() else forward)):
            yield AxisTable(
                input_axis=axis,
                output_axis=axis,
                position_mm=tuple(position),
                value_mm=tuple(-error),
                travel=travel,
            )


PLANTS: dict[str, type[Plant]] = {
    "siemens": SiemensPlant,
    "fanuc": FanucPlant,
    "heidenhain": HeidenhainPlant,
    "beckhoff": BeckhoffPlant,
    "linuxcnc": LinuxCncPlant,
    "mitsubishi": MitsubishiPlant,
    "fagor": FagorPlant,
}
