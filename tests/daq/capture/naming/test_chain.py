"""The chain that names stops by the laser alone: drawn boxes, drawn errors of machine and mirror,
one drawn fault each."""

import numpy as np
import pytest

from stepdiag.daq.capture.naming.walk import SURE, Chain, Look, Path
from stepdiag.daq.survey.file import parse_survey
from testkit.examples import spread
from testkit.routes import make_route
from testkit.timeline import survey_text

DRAWS = len(spread(range(60), 2))
LEAST_RIGHT = 0.97
"""Boxes whose axes make nearly the same step hide a missed stop, or a pass that was begun anew."""


def drawn(rng):
    """Return a route, and the laser's readings at its stops: machine and mirror are off by 1e-4 and
    1e-3 of the way."""
    size, n = np.round(rng.uniform((200, 150, 80), (600, 400, 300))), int(rng.integers(2, 6))
    route = make_route(
        parse_survey(survey_text(size=tuple(size), n=n), "s").volume,
        "ppp",
        "xyz",
        outward=True,
    )
    steps = (
        np.diff(route.nominal_mm)
        * (1 - 1e-3 * rng.uniform(0, 1))
        * (1 + 1e-4 * rng.normal(0, 1, len(route) - 1))
    )
    return route, np.concatenate(([0.0], np.cumsum(steps))) + rng.uniform(-500, 500)


def with_fault(kind, route, read, rng):
    """Return the standstills of a pass with one fault as (true stop, reading, lost)."""
    at = int(rng.integers(2, len(route) - 1))
    stands = [(stop, reading, False) for stop, reading in enumerate(read)]
    if kind == "hold":
        part = rng.uniform(0.2, 0.8)
        return [
            *stands[:at],
            (None, read[at - 1] + part * (read[at] - read[at - 1]), False),
            *stands[at:],
        ]
    if kind == "missed":
        return [*stands[:at], *stands[at + 1 :]]
    if kind == "again":
        back = int(rng.integers(0, at))
        return [*stands[: at + 1], *stands[back:]]
    if kind == "slip":
        return [
            *stands[:at],
            *((stop, reading + 0.4, False) for stop, reading, _ in stands[at:]),
        ]
    if kind in ("lost", "lost and anew"):
        begun, moved = (at, 0)[kind != "lost"], rng.uniform(-50, 50)
        return [
            *stands[:at],
            *((stop, reading + moved, stop == begun) for stop, reading, _ in stands[begun:]),
        ]
    return stands


@pytest.mark.parametrize(
    "kind", ["none", "hold", "missed", "again", "slip", "lost", "lost and anew"]
)
def test_a_pass_with_one_fault_is_named_right_at_its_end(kind):
    """The names are those of the path at the end; if they are wrong, the margin was small at some
    standstill."""
    rng = np.random.default_rng(40)
    right = surely_wrong = 0
    for _ in range(DRAWS):
        route, read = drawn(rng)
        chain, before, unsure = Chain((route,), Path()), (), False
        stands = with_fault(kind, route, read, rng)
        for _, reading, lost in stands:
            before += chain.best.names if lost else ()
            path = chain.take(Look(reading_mm=float(reading), lost=lost))
            unsure |= chain.margin < SURE
        same = [*before, *path.names] == [stop for stop, *_ in stands]
        right += same
        surely_wrong += not (same or unsure)
    assert right >= LEAST_RIGHT * DRAWS
    assert surely_wrong == 0


def test_an_observation_without_a_memory_names_nothing():
    """After a lost count the next stop and the first stop are about as likely."""
    route, read = drawn(np.random.default_rng(1))
    chain = Chain((route,), Path())
    for reading in read[:3]:
        chain.take(Look(reading_mm=float(reading)))
        assert chain.margin >= SURE
    assert chain.take(Look(reading_mm=0.0, lost=True)).name == 3
    assert chain.margin < SURE


@pytest.mark.parametrize(("order", "outward"), [("yxz", True), ("zyx", True), ("xyz", False)])
def test_a_program_in_another_order_or_from_the_other_end_keeps_its_numbers(order, outward):
    """Its steps are those of other axes or the other way: each stop is named, to be refused."""
    rng = np.random.default_rng(41)
    right = 0
    for _ in range(DRAWS):
        size, n = (
            np.round(rng.uniform((400, 200, 80), (600, 300, 150))),
            int(rng.integers(2, 6)),
        )
        volume = parse_survey(survey_text(size=tuple(size), n=n), "s").volume
        driven = make_route(volume, "ppp", order, outward=outward)
        chain = Chain((make_route(volume, "ppp", "xyz", outward=True),), Path())
        for reading in driven.nominal_mm:
            path = chain.take(Look(reading_mm=float(reading)))
        right += path.names == tuple(range(len(driven)))
    assert right >= LEAST_RIGHT * DRAWS
