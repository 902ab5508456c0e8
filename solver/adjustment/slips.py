"""The largest slip of the laser's count that a survey does not detect: the minimal detectable
bias (Baarda 1968) of a step of the count, including the usual random effects. The formula needs
no readings, so a plan can use it before the survey."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from stepdiag.base.result.members import UnseenSlip, UnseenSlips
from stepdiag.base.volume import Vector
from stepdiag.solver.adjustment.counts import Count, counts, from_each_on, short_counts
from stepdiag.solver.adjustment.evidence import HIDDEN, STEP, log_prior, standing_out
from stepdiag.solver.adjustment.faults import LEAST_UM
from stepdiag.solver.linear.mixed import MixedFit
from stepdiag.solver.linear.ties import first_of_the_largest
from stepdiag.solver.model.design import Design
from stepdiag.solver.model.layout import Layout
from stepdiag.solver.model.quantities import lattice_field_um, quantities

NEARLY_ALWAYS = 1.6
"""Size of a step that is detected in 95 % of the surveys, divided by the size of a step detected in
half of the surveys. For a normal distribution the ratio is 6.65 / 5; it is larger here, because
random effects explain part of a step."""
MOST_STANDING = 10.0
"""Largest number of standard uncertainties that a step needs to be detected. In surveys with three
to ten degrees of freedom, nearly all slips of 1.6 times this limit were detected."""
TELLS_MORE = 1.3
"""Ratio of the error over the volume with and without a slip above which the slip is reported
with its pass."""
KINDS = {"diagonals": ("step", "face"), "runs": ("linear",)}
"""Names of the groups of setups in the result, and the kinds of setups in each group."""


def _u_um(fit: MixedFit, count: Count) -> Vector:
    """Return the standard uncertainty of a step before each reading except the first, infinite
    if it is not visible."""
    mixed = from_each_on(fit.taken_over[count.rows])
    seen = (count.step - np.sum(mixed**2, axis=1))[1:]
    visible = seen > HIDDEN * from_each_on(fit.weight[count.rows])[1:]
    found: Vector = np.where(visible, 1.0 / np.sqrt(np.where(visible, seen, np.nan)), np.inf)
    return found


def stands_out(fit: MixedFit, layout: Layout) -> float:
    """Return the number of standard uncertainties above which a step is not chance
    (`solver.adjustment.evidence`), at most `MOST_STANDING`."""
    return standing_out(
        max(fit.freedom, 1),
        log_prior(STEP, int(np.count_nonzero(fit.weight[: len(layout)]))),
        MOST_STANDING,
    )


def slips_report(
    fit: MixedFit, layout: Layout, design: Design, wanted: Collection[str] = tuple(KINDS)
) -> UnseenSlips | None:
    """Return the most harmful undetected slip of the diagonals and of the linear runs in um. None
    means that a slip of any size is undetected.

    ``half_um`` is the size of a slip that half of all surveys detect. ``volume_um`` is the effect
    of this slip on the identified errors over the volume (rms); ``readings_um`` is the effect of
    the noise (k = 1). ``passes`` are the passes in which a slip and the noise together have more
    than `TELLS_MORE` times the effect of the noise. U does not include a slip.
    """
    field, report, out = (
        _Field.of(fit, layout, design),
        dict[str, UnseenSlip](),
        stands_out(fit, layout),
    )
    noise_um = field.noise_um()
    for name in wanted:
        kinds = KINDS[name]
        # in a count with few readings, a slip of any size is undetected
        every = [
            _Worst(row=int(rows[1]), u_um=np.inf, made_um=np.inf)
            for rows in short_counts(fit.fixed, layout, kinds)
        ]
        every += [
            worst
            for count in counts(fit.fixed, layout, kinds).single
            for worst in _worst_in(field, layout, count, out)
        ]
        if every:
            worst = every[first_of_the_largest([each.made_um for each in every])]
            more = [
                each
                for each in every
                if np.hypot(each.made_um, noise_um) > TELLS_MORE * noise_um > 0.0
            ]
            passes = tuple(layout.passes[layout.pass_index[each.row]].place for each in more)
            report[name] = _slip(layout, worst, out, noise_um, passes)
    return UnseenSlips(**report) if report else None


class _Worst(NamedTuple):
    row: int
    u_um: float
    made_um: float


def _worst_in(field: "_Field", layout: Layout, count: Count, out: float) -> Iterator[_Worst]:
    """Yield for every pass of a count the step that is detected in half of the surveys and has the
    largest effect on the volume.

    A step at the reversal is the least visible, because backlash hides it, but it has no effect on
    the volume.
    """
    u_um, moved_um = _u_um(field.fit, count), field.moved_um(count)
    visible = np.isfinite(u_um)
    unseen = np.where(moved_um > HIDDEN, np.inf, 0.0)
    made = np.where(
        visible,
        moved_um * np.maximum(out * np.where(visible, u_um, np.nan), LEAST_UM),
        unseen,
    )
    passes = layout.pass_index[count.rows[1:]]
    for number in np.unique(passes):
        mine = np.flatnonzero(passes == number)
        place = int(mine[first_of_the_largest(made[mine])])
        yield _Worst(
            row=int(count.rows[place + 1]),
            u_um=float(u_um[place]),
            made_um=float(made[place]),
        )


def _slip(
    layout: Layout, worst: _Worst, out: float, noise_um: float, passes: tuple[str, ...]
) -> UnseenSlip:
    key, u_um = layout.passes[layout.pass_index[worst.row]], worst.u_um
    noticed = bool(np.isfinite(u_um))
    return UnseenSlip(
        setup=key.setup,
        pass_number=key.number,
        stop=int(layout.stop[worst.row]),
        half_um=max(out * u_um, LEAST_UM) if noticed else None,
        nearly_um=max(NEARLY_ALWAYS * out * u_um, LEAST_UM + 2.0 * u_um) if noticed else None,
        volume_um=worst.made_um if noticed else None,
        readings_um=noise_um,
        passes=passes,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Field:
    """The identified errors at all points of the volume, reduced to k numbers whose sum of squares
    is equal to that of the errors.

    ``by_unknowns`` (k, count) and ``by_readings`` (m, k) are the effects of one unit of each
    unknown, and of 1 um in each reading, on these numbers in um. ``values`` is the number of error
    components at all points.
    """

    fit: MixedFit
    by_unknowns: Vector
    by_readings: Vector
    values: int

    @classmethod
    def of(cls, fit: MixedFit, layout: Layout, design: Design) -> Self:
        every = quantities(design.columns, layout.volume)
        wanted = every.select(np.flatnonzero(fit.inverse.sees(every.combination)))
        field = lattice_field_um(wanted, layout.volume, design.chain)
        flat = field.reshape(3 * len(field), field.shape[2])
        # values between the nodes have no effect at the points of the lattice
        moving = np.flatnonzero(np.any(flat, axis=0))
        by_unknowns = (
            np.linalg.qr(flat[:, moving], mode="r")
            @ wanted.select(moving).combination.dense()
        )
        through = fit.amount_covariance @ (fit.causes.taken.T @ by_unknowns.T)
        direct = fit.weight[:, None] * fit.fixed.packed.times(
            fit.inverse.solve(by_unknowns.T)
        )
        return cls(
            fit=fit,
            by_unknowns=by_unknowns,
            by_readings=direct - fit.causes.left @ through,
            values=len(flat),
        )

    def noise_um(self) -> float:
        """Return the effect of the noise on the errors over the volume (rms, k = 1)."""
        known = self.fit.inverse.solve(self.by_unknowns.T)
        return float(
            np.sqrt(max(3.0 * float(np.sum(self.by_unknowns.T * known)) / self.values, 0.0))
        )

    def moved_um(self, count: Count) -> Vector:
        """Return the effect on the errors over the volume (rms) of a step of 1 um before each
        reading except the first."""
        return self._rms_um(from_each_on(self.by_readings[count.rows])[1:])

    def _rms_um(self, off_um: Vector) -> Vector:
        found: Vector = np.sqrt(3.0 * np.sum(off_um**2, axis=-1) / self.values)
        return found
