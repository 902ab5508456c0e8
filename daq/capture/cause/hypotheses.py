"""The library of causes: each cause changes one statement of the survey file."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from stepdiag.base.messages import message
from stepdiag.base.names import AXES, SETUP_NUMBERS
from stepdiag.base.readings.runs import Plan, order_of
from stepdiag.base.setups import setup_of
from stepdiag.daq.capture.cause.likelihood import (
    CONFIRMED,
    EDGE_S,
    LEAST_LATE_S,
    Cause,
    Change,
    Evidence,
    Matrix,
    Move,
)
from stepdiag.daq.capture.log_start import PassHint
from stepdiag.daq.capture.naming.route import Route, route_of
from stepdiag.daq.capture.noise import PLACED_MM, SIGMAS
from stepdiag.daq.survey.models import Survey

FACTORS = (25.4, 1 / 25.4, 10.0, 0.1, 2.0, 0.5)


@dataclass(frozen=True, slots=True)
class Library:
    """The causes that a survey may have, for the standstills of a pass."""

    survey: Survey
    hints: Mapping[str, PassHint]
    evidence: Evidence

    def plain(self, setup: str | None) -> Iterator[Cause]:
        """Yield the hypotheses of the unchanged survey file: the next pass out, the next pass back,
        and the passes with other orders of the axes that may come instead.
        """
        for number in self._numbers(setup) if setup is not None else ():
            yield Cause(route_of(self.survey.planned, setup or "", number))

    def hypotheses(self, setup: str | None) -> Iterator[Cause]:
        """Yield every cause of a pass of the setup that the signals state."""
        shown, steps = self.evidence.shown_mm(), self.evidence.steps_mm()
        if setup is not None:
            route = self._route(setup)
            yield from self._laser_causes(route)
            yield from self._time_causes(route)
            if setup_of(setup).is_diagonal:
                yield from self._order_causes(setup, shown)
            yield from self._box_causes(setup, shown, steps)
            if shown is not None:
                yield from self._map_causes(route, shown)
        if self.evidence.stands[0].signals.setup is not None and shown is not None:
            yield from self._code_causes(setup)

    def _laser_causes(self, route: Route) -> Iterator[Cause]:
        laser = self.survey.laser
        yield Cause(
            route,
            laser=-1.0,
            kind="laser.sign",
            what=message("cause-laser-sign"),
            changes=(("laser.sign", f"{-laser.sign}"),),
        )
        wanted, seen = (
            np.diff(route.nominal_mm[: len(self.evidence)]),
            self.evidence.steps_mm()[: len(route) - 1],
        )
        fitted = float(f"{np.nansum(seen * wanted) / np.sum(wanted**2):.4g}")
        for factor in dict.fromkeys((*FACTORS, 4.0, 0.25, fitted)):
            free = int(factor == fitted and factor not in FACTORS)
            yield Cause(
                route,
                laser=factor,
                free=free,
                kind="laser.factor",
                what=message("cause-laser-factor", factor=factor),
                changes=(laser_change(self.survey, factor),),
            )

    def _time_causes(self, route: Route) -> Iterator[Cause]:
        """Yield the causes in time: a late laser, a late control, or an early stop bit, with the
        delays of the moves.
        """
        laser_s, plc_s, settle_s = (
            self.survey.laser.latency_s,
            self.survey.plc.latency_s,
            self.survey.stop.settle_s,
        )
        for both in self._seen_s(
            lambda move: 0.5 * (move.left_s + move.came_s),
            lambda move: move.left_s - move.came_s,
        ):
            if both > 0:
                what, change = (
                    message("cause-laser-late", late_s=both),
                    ("laser.latency_s", f"{laser_s + both:.2f}"),
                )
            else:
                what, change = (
                    message("cause-plc-late", late_s=-both),
                    ("plc.latency_s", f"{plc_s - both:.2f}"),
                )
            yield Cause(
                route,
                late_s=(both, both),
                free=1,
                kind=change[0],
                what=what,
                changes=(change,),
            )
        for came in self._seen_s(lambda move: move.came_s, lambda move: move.left_s):
            if came > 0:
                yield Cause(
                    route,
                    late_s=(0.0, came),
                    free=1,
                    kind="bit early",
                    what=message("cause-bit-early", early_s=came),
                    changes=(("stop.settle_s", f"{settle_s + came:.2f}"),),
                )

    def _seen_s(
        self, late_s: Callable[[Move], float], off_s: Callable[[Move], float]
    ) -> list[float]:
        """Return the different delays of the moves in s; agreeing delays are replaced by their
        mean. ``late_s`` gives a move's delay; ``off_s`` is zero for a move that has such a delay.
        """
        seen = sorted(
            late_s(move)
            for each in self.evidence.stands
            for move in each.moves
            if abs(off_s(move)) < SIGMAS * move.u_s and abs(late_s(move)) > LEAST_LATE_S
        )
        groups: list[list[float]] = []
        for value in seen:
            if groups and value - groups[-1][-1] < EDGE_S:
                groups[-1].append(value)
            else:
                groups.append([value])
        return [
            round(float(np.median(group)), 2) for group in groups if len(group) >= CONFIRMED
        ]

    def _order_causes(self, setup: str, shown: Matrix | None) -> Iterator[Cause]:
        """Yield a cause for every other order of the axes. Orders that no observation separates,
        because two axes make the same step, are one cause.
        """
        alike: dict[bytes, tuple[list[str], Route]] = {}
        planned = self.survey.planned
        run = planned.run_of(setup)
        as_stated = {order_of(planned, run, number) for number in self._numbers(setup)}
        # as in the survey file, `plan.axis_orders` has priority over `volume.axis_order`
        line, value = (
            ("plan.axis_orders", '["{}"]')
            if run.axis_orders
            else ("volume.axis_order", '"{}"')
        )
        for order in map("".join, permutations(AXES)):
            route = self._route(
                setup, replace(planned, runs=(replace(run, axis_orders=(order,)),))
            )
            seen = route.nominal_mm if shown is None else route.stops_mm
            alike.setdefault(np.round(seen, 3).tobytes(), ([], route))[0].append(order)
        for orders, route in alike.values():
            if as_stated.isdisjoint(orders):
                values = " or ".join(map(value.format, orders))
                yield Cause(
                    route,
                    kind=f"order {values}",
                    what=message("cause-axis-order", orders=orders),
                    changes=((line, values),),
                )

    def _box_causes(self, setup: str, shown: Matrix | None, steps: Matrix) -> Iterator[Cause]:
        """Yield every box in which one axis has another length, computed from the positions, or
        else from the steps.
        """
        for axis in range(3):
            for length_mm in self._lengths_mm(axis, shown, steps, setup):
                plan = _resized(self.survey.planned, axis, length_mm)
                route = self._route(setup, plan)
                yield Cause(
                    route,
                    free=1,
                    kind=f"box {axis}",
                    what=message("cause-box", axis=AXES[axis].upper(), length_mm=length_mm),
                    changes=(
                        (
                            "volume.size_mm",
                            str([round(value, 4) for value in plan.volume.size_mm]),
                        ),
                    ),
                )

    def _lengths_mm(
        self, axis: int, shown: Matrix | None, steps: Matrix, setup: str
    ) -> list[float]:
        increments, size = self.survey.volume.increments, self.survey.volume.size_mm[axis]
        moved = (
            float(np.max(np.abs(np.diff(shown[:, axis])), initial=0.0))
            if shown is not None
            else 0.0
        )
        if shown is not None and moved > PLACED_MM:
            lengths = [
                moved * increments,
                float(np.max(np.abs(shown[:, axis] - self.survey.volume.origin_mm[axis]))),
            ]
        # a longer axis turns the diagonal: the steps of the other axes show this before the longer
        # axis moves
        else:
            lengths = [self._length_by_laser(setup, axis, steps)]
        return [
            round(each, 3) for each in lengths if each > 1.0 and abs(each - size) > PLACED_MM
        ]

    def _length_by_laser(self, setup: str, axis: int, steps: Matrix) -> float:
        """Return the length in mm of one axis at which the laser's steps fit best. The length is
        searched on a grid, then between the neighbouring points. If the steps do not depend on the
        length, the stated length is returned.
        """
        route, size = self._route(setup), np.array(self.survey.volume.size_mm)
        signs, stated_mm = np.array(route.travel.signs), float(size[axis])
        if not signs[axis] or len(route) <= len(steps):
            return stated_mm
        # travel of each axis in a step; the reading is the projection of this travel on the
        # diagonal
        share = signs * np.diff(route.stops_mm[: len(steps) + 1], axis=0)
        share = np.divide(share, size, out=np.zeros_like(share), where=size > 0)

        def misfit(lengths_mm: Matrix) -> Matrix:
            squares = np.tile((signs * size) ** 2, (len(lengths_mm), 1))
            squares[:, axis] = lengths_mm**2
            nominal = squares @ share.T / np.sqrt(squares.sum(axis=1, keepdims=True))
            return np.asarray(np.nansum((steps - nominal) ** 2, axis=1))

        low, high = 0.2 * stated_mm, 4.0 * stated_mm
        for _ in range(6):
            grid = np.linspace(low, high, 25)
            best = int(np.argmin(misfit(grid)))
            low, high = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, 24)])
        return 0.5 * (low + high)

    def _route(self, setup: str, plan: Plan | None = None, *, outward: bool = True) -> Route:
        """Return the route of the next pass of a setup in the survey's plan, or in ``plan``."""
        return route_of(
            plan or self.survey.planned, setup, self._number(setup, outward=outward)
        )

    def _numbers(self, setup: str) -> tuple[int, ...]:
        """Return the numbers of the passes that may come next: out, back, and in other orders."""
        hint = self.hints.get(setup, PassHint())
        return *hint.numbers, *hint.others

    def _number(self, setup: str, *, outward: bool = True) -> int:
        return self._numbers(setup)[0 if outward else 1]

    def _map_causes(self, route: Route, shown: Matrix) -> Iterator[Cause]:
        """Yield the causes in the map of positions (offset, sign, factor and others), on the route
        that the file states.
        """
        first = shown[0]
        start = route.stops_mm[0]
        for axis in range(3):
            moved = float(first[axis] - start[axis])
            yield self._mapped(route, "offset", [axis], shifts={axis: moved}, free=1)
            turned = float(first[axis] + start[axis])
            yield self._mapped(route, "sign", [axis], factors={axis: -1.0})
            yield self._mapped(
                route,
                "sign-offset",
                [axis],
                factors={axis: -1.0},
                shifts={axis: turned},
                free=1,
            )
            for factor in FACTORS:
                yield self._mapped(route, "factor", [axis], factors={axis: factor})
        yield self._mapped(
            route,
            "offset",
            [0, 1, 2],
            shifts=dict(enumerate((first - start).tolist())),
            free=3,
        )
        for factor in (*FACTORS, -1.0):
            yield self._mapped(
                route, "factor", [0, 1, 2], factors=dict.fromkeys(range(3), factor)
            )
        for axes in permutations(range(3)):
            if axes != (0, 1, 2):
                yield self._permuted(route, axes)
        if np.ptp(shown, axis=0).max() <= PLACED_MM:
            lines = tuple((f"plc.signals.{axis}_mm", "") for axis in AXES)
            yield Cause(
                route,
                factors=(0.0, 0.0, 0.0),
                shifts_mm=tuple(first.tolist()),
                kind="standing",
                free=0 if np.abs(first).max() <= PLACED_MM else 3,
                what=message("cause-not-commanded"),
                changes=lines,
            )

    def _mapped(
        self,
        route: Route,
        key: str,
        axes: Sequence[int],
        *,
        factors: dict[int, float] | None = None,
        shifts: dict[int, float] | None = None,
        free: int = 0,
    ) -> Cause:
        k = np.array([(factors or {}).get(axis, 1.0) for axis in range(3)])
        c = np.array([(shifts or {}).get(axis, 0.0) for axis in range(3)])
        changes: list[Change] = []
        for axis in axes:
            spec = self.survey.plc.signals.get(f"{AXES[axis]}_mm")
            if spec is None:
                continue
            name = f"plc.signals.{AXES[axis]}_mm"
            if k[axis] != 1.0:
                changes.append((f"{name}.scale", f"{spec.scale / k[axis]:.9g}"))
            if abs(c[axis]) > PLACED_MM:
                changes.append(
                    (f"{name}.offset", f"{round((spec.offset - c[axis]) / k[axis], 4):.9g}")
                )
        named = ", ".join(AXES[axis].upper() for axis in axes)
        what = message(
            "cause-map", axes=named, factor=float(k[axes[0]]), shift_mm=float(c[axes[0]])
        )
        return Cause(
            route,
            factors=tuple(k.tolist()),
            shifts_mm=tuple(c.tolist()),
            free=free,
            kind=f"{key} {named}",
            what=what,
            changes=tuple(changes),
        )

    def _permuted(self, route: Route, axes: tuple[int, ...]) -> Cause:
        specs = [self.survey.plc.signals.get(f"{axis}_mm") for axis in AXES]
        changes = tuple(
            (f"plc.signals.{AXES[shows]}_mm.address", str(spec.address))
            for at, shows in enumerate(axes)
            if at != shows and (spec := specs[at]) is not None
        )
        shows = "".join(AXES[axis].upper() for axis in axes)
        return Cause(
            route,
            axes=axes,
            kind=f"permuted {axes}",
            what=message("cause-permuted", shows=shows),
            changes=changes,
        )

    def _code_causes(self, setup: str | None) -> Iterator[Cause]:
        """Yield a cause for every other setup of the plan: the machine drives this setup, and the
        signals' code states another. If another setup is complete, its code is right, so no offset
        corrects all codes.
        """
        code = self.evidence.stands[0].signals.setup
        signal = self.survey.plc.signals.get("setup")
        right = not all(hint.wanted for hint in self.hints.values())
        for name in self.hints:
            number = next(
                (
                    number
                    for number, base in SETUP_NUMBERS.items()
                    if base == setup_of(name).base
                ),
                None,
            )
            if name == setup or number is None or code is None or setup_of(name).is_fourdof:
                continue
            route = self._route(name)
            what = message(
                "cause-setup-code",
                code=code,
                stated=setup or message("unknown-setup"),
                driven=name,
            )
            offset = number - code + (signal.offset if signal else 0.0)
            change = ("plc.signals.setup.offset", f"{offset:g}")
            yield Cause(
                route,
                kind=f"setup {name}",
                what=what,
                changes=(("plc.signals.setup", "") if right else change,),
            )


def laser_change(survey: Survey, factor: float) -> Change:
    """Return the change of the survey file that multiplies the laser's readings by ``1 /
    factor``.
    """
    laser = survey.laser
    if laser.format == "line" and laser.line is not None:
        return "laser.line.scale", f"{laser.line.scale / factor:.9g}"
    if laser.format == "frames" and laser.frames is not None:
        return "laser.frames.scale", f"{laser.frames.scale / factor:.9g}"
    if (optics := laser.optics * factor) in (1, 2, 4):
        return "laser.optics", f"{optics:g}"
    return "laser.wavelength_nm", f"{laser.wavelength_nm / factor:.7g}"


def _resized(plan: Plan, axis: int, length_mm: float) -> Plan:
    x_mm, y_mm, z_mm = (
        length_mm if each == axis else value for each, value in enumerate(plan.volume.size_mm)
    )
    return replace(plan, volume=replace(plan.volume, size_mm=(x_mm, y_mm, z_mm)))
