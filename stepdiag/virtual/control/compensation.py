"""Loading of compensation files into the virtual control, by the law of the control for which the
files are written."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from stepdiag.virtual.control.axis_table import AxisTable
from stepdiag.virtual.control.beckhoff import load_volumetric
from stepdiag.virtual.control.chain import ChainTable
from stepdiag.virtual.control.fanuc import load_fanuc
from stepdiag.virtual.control.heidenhain import load_tables
from stepdiag.virtual.control.lattice import LatticeTable, load_lattice
from stepdiag.virtual.control.linuxcnc import load_matrix, load_screw_file
from stepdiag.virtual.control.siemens import AXIS_NAMES, load_siemens

Control = Literal["siemens", "fanuc", "linuxcnc", "beckhoff", "heidenhain"]
Acting = AxisTable | LatticeTable | ChainTable
LARGEST_BYTES = 4_000_000
_COMP_SUFFIXES = (".comp", ".dat", ".txt")


def load_files(
    control: Control, files: Sequence[Path], chain: str = "FXYZ"
) -> Sequence[Acting]:
    """Return the active tables after all ``files`` have been loaded into a control of this make.

    A LinuxCNC screw file belongs to the axis in its name (``screw_x.comp``, ``compX.dat``). A
    ``.hal`` file sets the matrix kinematics; a ``.csv`` is the lattice of the kinematics component.
    A Beckhoff needs the kinematic ``chain`` as an argument; a Heidenhain reads the chain in the
    rows of the kinematics table (``.txt``). `load_siemens` and `load_fanuc` have options of a
    control as arguments. Raises ValueError for contents that the control refuses.
    """
    large = [file.name for file in files if file.stat().st_size > LARGEST_BYTES]
    if large:
        raise ValueError(f"{large[0]}: expected at most {LARGEST_BYTES} bytes")
    texts = [file.read_bytes().decode("ascii") for file in files]
    if control == "siemens":
        return [table for text in texts for table in load_siemens(text)]
    if control == "fanuc":
        return load_fanuc(texts)
    if control == "beckhoff":
        return [load_volumetric(text, chain=chain) for text in texts]
    if control == "heidenhain":
        return [_heidenhain(dict(zip((file.name for file in files), texts, strict=True)))]
    return [
        table
        for file, text in zip(files, texts, strict=True)
        for table in _linuxcnc(file, text)
    ]


def _heidenhain(texts: dict[str, str]) -> ChainTable:
    tables = {
        found[1]: text
        for name, text in texts.items()
        if (found := re.match(r"AXIS[-_](\w+?)(?:_UNTESTED_SIGN)?\.COM\Z", name))
    }
    lines = "".join(text for name, text in texts.items() if name.endswith(".txt"))
    return load_tables(
        tables, lines, axis_names={name: "XYZ"[AXIS_NAMES[name]] for name in tables}
    )


def _linuxcnc(file: Path, text: str) -> Sequence[Acting]:
    if file.suffix == ".csv":
        return [load_lattice(text)]
    if file.suffix not in _COMP_SUFFIXES:
        return load_matrix(text)
    named = re.search(r"(?:^|[^a-z])([xyz])(?:\Z|[^a-z])|([xyz])\Z", file.stem.lower())
    if named is None:
        raise ValueError(
            f"{file.name}: expected an axis in the name of a screw file, such as screw_x.comp"
        )
    return load_screw_file(text, "xyz".index(named[1] or named[2]))
