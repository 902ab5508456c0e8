"""A readings file that is solved together with other files; the result contains the SHA-256 of
every file."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from stepdiag.base.conformity import with_tolerance
from stepdiag.base.files import read_bytes, read_text
from stepdiag.base.readings.readings import Readings, in_mm, parse_readings
from stepdiag.base.result.members import Source
from stepdiag.base.result.result import Result
from stepdiag.daq.survey.assumed import parse_tolerance, parse_uncertainty
from stepdiag.solver.methods.solve import solve
from stepdiag.solver.model.angles import parse_angles
from stepdiag.solver.model.straightness_file import parse_straightness


@dataclass(frozen=True, slots=True, kw_only=True)
class Beside:
    """The files with which a readings file is solved. ``add`` adds runs from files of other
    programs; ``runs`` contains their names."""

    angles: Path | None = None
    straightness: Path | None = None
    uncertainty: Path | None = None
    tolerance: Path | None = None
    runs: tuple[Source, ...] = ()
    add: Callable[[Readings], Readings] | None = None


def source_of(role: str, path: Path) -> Source:
    """Return a file with its SHA-256. Raises UsageError for an unreadable file."""
    return Source(
        role=role, name=path.name, sha256=hashlib.sha256(read_bytes(path)).hexdigest()
    )


def solve_readings_file(
    path: Path, beside: Beside, *, method: str, chain: str, monte_carlo: int = 0
) -> Result:
    """Return the result of a readings file. Raises the UsageError and DataError of `solve` and of
    the parsers."""
    given = {
        "angles": beside.angles,
        "straightness": beside.straightness,
        "uncertainty": beside.uncertainty,
        "tolerance": beside.tolerance,
    }
    named = {
        role: (read_text(file), file.name) for role, file in given.items() if file is not None
    }
    readings = in_mm(parse_readings(read_text(path), path.name), path.name)
    result = solve(
        readings if beside.add is None else beside.add(readings),
        chain=chain,
        method=method,
        angles=parse_angles(*named["angles"]) if "angles" in named else None,
        straightness=parse_straightness(*named["straightness"])
        if "straightness" in named
        else (),
        assumed=parse_uncertainty(*named["uncertainty"]) if "uncertainty" in named else None,
        source=path.name,
        monte_carlo=monte_carlo,
    )
    files = (
        source_of(role, file)
        for role, file in {"readings": path, **given}.items()
        if file is not None
    )
    known = replace(result, sources=(*files, *beside.runs))
    return with_tolerance(
        known, parse_tolerance(*named["tolerance"]) if "tolerance" in named else {}
    )
