"""Values of positioning tests: ISO 230-2, ISO 230-6, ASME B5.54 and VDI/DGQ 3441.

None of these standards is public: the formulae are from general knowledge and agree with published
readings (theory.md 8.1-8.5). ``source_status`` states this in every result and report.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stepdiag.base.errors import DataError
from stepdiag.base.findings import Finding, finding, info
from stepdiag.base.messages import message

Vector = NDArray[np.float64]

CHECKED = "recalled; field names and values cross-checked with published reports"
RECALLED = "recalled, not checked against the standard"

MIN_RUNS = 5
MIN_TARGETS = 5
LONG_AXIS_MM = 2000.0
LONG_AXIS_INTERVAL_MM = 250.0
"""Requirements of ISO 230-2: at least five runs, and five targets per metre; on axes above 2 m
at most 250 mm between targets."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """The rule by which a standard computes a range: ``k`` standard deviations on each side of the
    mean."""

    standard: str
    k: float
    source_status: str


COVERAGES = {
    "iso-230-2": Coverage(standard="ISO 230-2:2014", k=2.0, source_status=CHECKED),
    "iso-230-2-1988": Coverage(standard="ISO 230-2:1988", k=3.0, source_status=RECALLED),
    "asme-b5.54": Coverage(standard="ASME B5.54-2005", k=2.0, source_status=RECALLED),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class PositioningRuns:
    """Deviations (actual minus target) in um: ``up_um`` and ``down_um`` (targets, runs);
    ``down_um`` is None if only one direction was measured."""

    target_mm: Vector
    up_um: Vector
    down_um: Vector | None = None

    def __post_init__(self) -> None:
        for name, table in (("up_um", self.up_um), ("down_um", self.down_um)):
            if table is not None and (
                table.ndim != 2 or len(table) != len(self.target_mm) or table.shape[1] < 1
            ):
                raise DataError(
                    name,
                    expected=message("targets-by-runs", target_mm=len(self.target_mm)),
                    found=message("shape-of-array", name=str(table.shape)),
                )
            if table is not None and not np.isfinite(table).all():
                raise DataError(
                    name,
                    expected=message("deviation-for-every-target"),
                    found=message("missing-one"),
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class PositioningFigures:
    """The values of one axis or diagonal in um, with the symbols of ISO 230-2. A value is None
    if the runs do not determine it."""

    standard: str
    source_status: str
    mean_up_um: Vector
    mean_down_um: Vector | None
    s_up_um: Vector | None
    s_down_um: Vector | None
    E_up: float
    E_down: float | None
    E: float | None
    M: float | None
    B: float | None
    B_mean: float | None
    R_up: float | None
    R_down: float | None
    R: float | None
    A_up: float | None
    A_down: float | None
    A: float | None
    findings: tuple[Finding, ...] = ()

    def numbers(self) -> dict[str, float]:
        """Return the values that the runs determine, by symbol."""
        named = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in named.items() if isinstance(value, float)}


def positioning_figures(
    runs: PositioningRuns, standard: str = "iso-230-2"
) -> PositioningFigures:
    """Return the values of an axis by a standard in ``COVERAGES`` (theory.md 8.1; B5.54: 8.5).

    ``R_i = max(k s_up + k s_down + |B_i|, 2 k s_up, 2 k s_down)``: a linear sum, not the root of
    squares.
    """
    coverage = COVERAGES[standard]
    up = runs.up_um.mean(axis=1)
    down = None if runs.down_um is None else runs.down_um.mean(axis=1)
    s_up, s_down = _scatter(runs.up_um), _scatter(runs.down_um)
    reversal = None if down is None else up - down
    return PositioningFigures(
        standard=coverage.standard,
        source_status=coverage.source_status,
        mean_up_um=up,
        mean_down_um=down,
        s_up_um=s_up,
        s_down_um=s_down,
        E_up=float(np.ptp(up)),
        E_down=None if down is None else float(np.ptp(down)),
        E=None if down is None else float(np.ptp([up, down])),
        M=None if down is None else float(np.ptp((up + down) / 2)),
        B=None if reversal is None else float(np.abs(reversal).max()),
        B_mean=None if reversal is None else float(reversal.mean()),
        R_up=_repeatability(coverage.k, s_up),
        R_down=_repeatability(coverage.k, s_down),
        R=_bidirectional_repeatability(coverage.k, s_up, s_down, reversal),
        A_up=_accuracy(coverage.k, (up, s_up)),
        A_down=_accuracy(coverage.k, (down, s_down)),
        A=_accuracy(coverage.k, (up, s_up), (down, s_down)),
        findings=_plan_findings(runs),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagonalFigures:
    """The values of ISO 230-6 for each diagonal and for the machine, which has the largest
    value of its diagonals."""

    standard: str
    source_status: str
    diagonals: Mapping[str, PositioningFigures]
    E_d: float | None
    B_d: float | None
    R_d: float | None
    A_d: float | None


def diagonal_figures(runs: Mapping[str, PositioningRuns]) -> DiagonalFigures:
    """Return the values of displacement tests along diagonals (theory.md 8.3); targets are
    distances along the diagonal."""
    each = {name: positioning_figures(table) for name, table in runs.items()}
    return DiagonalFigures(
        standard="ISO 230-6:2002",
        source_status=RECALLED,
        diagonals=each,
        E_d=_largest([figures.E for figures in each.values()]),
        B_d=_largest([figures.B for figures in each.values()]),
        R_d=_largest([figures.R for figures in each.values()]),
        A_d=_largest([figures.A for figures in each.values()]),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class VdiFigures:
    """The values of VDI/DGQ 3441 in um: position uncertainty P, position deviation Pa, reversal
    U, position scatter Ps."""

    standard: str
    source_status: str
    P: float
    Pa: float
    U_max: float
    U_mean: float
    Ps_max: float
    Ps_mean: float


def vdi_3441_figures(runs: PositioningRuns) -> VdiFigures:
    """Return the values of VDI/DGQ 3441 (theory.md 8.4). Raises DataError without two runs in
    each direction."""
    s_up, s_down = _scatter(runs.up_um), _scatter(runs.down_um)
    if runs.down_um is None or s_up is None or s_down is None:
        raise DataError(
            "VDI/DGQ 3441", expected=message("two-runs-more-both"), found=message("fewer")
        )
    up, down = runs.up_um.mean(axis=1), runs.down_um.mean(axis=1)
    middle, reversal, scatter = (up + down) / 2, np.abs(up - down), 6 * (s_up + s_down) / 2
    half_width = (reversal + scatter) / 2
    return VdiFigures(
        standard="VDI/DGQ 3441:1977",
        source_status=RECALLED,
        P=float((middle + half_width).max() - (middle - half_width).min()),
        Pa=float(np.ptp(middle)),
        U_max=float(reversal.max()),
        U_mean=float(reversal.mean()),
        Ps_max=float(scatter.max()),
        Ps_mean=float(scatter.mean()),
    )


def arrange_runs(
    target_mm: ArrayLike,
    pass_number: ArrayLike,
    deviation_um: ArrayLike,
    *,
    common_zero: bool,
) -> tuple[PositioningRuns, tuple[Finding, ...]]:
    """Return the passes of a setup as a table of deviations by target and run, and the reasons for
    omitted passes.

    Odd passes are outward (up), even passes return (down). If the readings restart at zero in every
    pass (``common_zero=False``), the reversal is unknown, and only the outward passes are used.
    """
    targets, row = np.unique(np.asarray(target_mm, dtype=np.float64), return_inverse=True)
    passes = np.asarray(pass_number, dtype=np.int64)
    deviation = np.asarray(deviation_um, dtype=np.float64)
    up, down = (
        _pass_columns(row, len(targets), passes, deviation, parity) for parity in (1, 0)
    )
    if down.shape[1] == 0:
        return PositioningRuns(target_mm=targets, up_um=up), ()
    if not common_zero:
        return PositioningRuns(target_mm=targets, up_um=up), (info("iso230-plan.zero"),)
    return PositioningRuns(target_mm=targets, up_um=up, down_um=down), ()


def _pass_columns(
    row: NDArray[np.intp],
    targets: int,
    passes: NDArray[np.int64],
    deviation: Vector,
    parity: int,
) -> Vector:
    numbers = np.unique(passes[passes % 2 == parity])
    table = np.full((targets, len(numbers)), np.nan)
    for column, number in enumerate(numbers):
        table[row[passes == number], column] = deviation[passes == number]
    return table


def _scatter(table: Vector | None) -> Vector | None:
    if table is None or table.shape[1] < 2:
        return None
    scatter: Vector = table.std(axis=1, ddof=1)
    return scatter


def _repeatability(k: float, s: Vector | None) -> float | None:
    return None if s is None else float(2 * k * s.max())


def _bidirectional_repeatability(
    k: float, s_up: Vector | None, s_down: Vector | None, reversal: Vector | None
) -> float | None:
    if s_up is None or s_down is None or reversal is None:
        return None
    linear_sum = k * s_up + k * s_down + np.abs(reversal)
    return float(np.max([linear_sum, 2 * k * s_up, 2 * k * s_down]))


def _accuracy(k: float, *directions: tuple[Vector | None, Vector | None]) -> float | None:
    tops, bottoms = [], []
    for mean, s in directions:
        if mean is None or s is None:
            return None
        tops.append(mean + k * s)
        bottoms.append(mean - k * s)
    return float(np.max(tops) - np.min(bottoms))


def _largest(values: Sequence[float | None]) -> float | None:
    """Return the largest value, or None if a diagonal has no value: a maximum over some diagonals
    is not a value of the machine."""
    known = [value for value in values if value is not None]
    return max(known) if known and len(known) == len(values) else None


def _plan_findings(runs: PositioningRuns) -> tuple[Finding, ...]:
    span_mm = float(np.ptp(runs.target_mm))
    found = []
    if span_mm > LONG_AXIS_MM:
        widest = float(np.diff(np.sort(runs.target_mm)).max())
        if widest > LONG_AXIS_INTERVAL_MM:
            found.append(
                message(
                    "iso230-plan.interval",
                    interval_mm=widest,
                    long_mm=LONG_AXIS_MM,
                    most_mm=LONG_AXIS_INTERVAL_MM,
                )
            )
    else:
        needed = max(MIN_TARGETS, int(np.ceil(MIN_TARGETS * span_mm / 1000)))
        if len(runs.target_mm) < needed:
            found.append(
                message(
                    "iso230-plan.targets",
                    count=len(runs.target_mm),
                    span_mm=span_mm,
                    needed=needed,
                )
            )
        fewest = min(
            table.shape[1] for table in (runs.up_um, runs.down_um) if table is not None
        )
        if fewest < MIN_RUNS:
            found.append(message("iso230-plan.runs", count=fewest, needed=MIN_RUNS))
    return tuple(finding("warning", words) for words in found)
