"""A survey of the exact virtual machine as captured stops, with a slip of the count where a test
wants one; and what is left of it."""

from dataclasses import dataclass

import msgspec
import numpy as np

from stepdiag.base.result.field import error_field_um, without_rigid_motion
from stepdiag.daq.capture.captured_stop import CapturedStop
from stepdiag.daq.passes.pass_book import PassBook
from stepdiag.daq.passes.tabulate import tabulate
from stepdiag.daq.passes.verdict import settled_findings, suspected
from stepdiag.daq.survey.assumed import assumptions_of
from stepdiag.daq.survey.file import parse_survey
from stepdiag.solver.methods.solve import solve
from stepdiag.virtual.drive.sequence import Box
from stepdiag.virtual.drive.setups import Alignment
from stepdiag.virtual.physics.error_functions import Amplitudes, random_errors
from stepdiag.virtual.physics.machine import Machine
from testkit.exact.surveys import IDEAL_SECTION
from testkit.ordinary.measured import Conditions, simulate_pass
from testkit.routes import make_route
from testkit.timeline import survey_text

SIZE_MM = (300.0, 200.0, 100.0)
SETUPS = ("ppp", "npp", "pnp", "ppn", "linear-x", "linear-y", "linear-z")
WANTED = Amplitudes(positioning_um=6.0, straightness_um=5.0, angle_urad=2.0, scale_um_m=20.0)


@dataclass(frozen=True)
class Slip:
    """The count goes wrong by some um on the way to a stop, and stays so until the laser is set up
    anew."""

    setup: str
    pass_number: int
    stop: int
    size_um: float


@dataclass(frozen=True)
class Survey:
    """What came of it: the volume's rms error before and after, in um, the places doubted, and the
    places that findings name."""

    before_um: float
    after_um: float
    doubted: frozenset[str]
    named: frozenset[str]


def survey_of(*slips, n=4, back=False, seed=1, ideal=False):
    """Return what comes of a survey of a drawn machine, solved and compensated with what was found;
    ``ideal`` where its file says so."""
    text = survey_text(size=SIZE_MM, n=n, setups=SETUPS, back=back) + IDEAL_SECTION * ideal
    survey = parse_survey(text, "survey.toml")
    box = Box(size_mm=SIZE_MM, increments=n)
    machine = Machine(
        errors=random_errors(seed, (0.0, 0.0, 0.0), SIZE_MM, WANTED), chain="FXYZ"
    )
    book = PassBook(survey)
    start_s = 0.0
    for setup in SETUPS:
        off_um = 0.0
        for number in (1, 2) if back else (1,):
            stops = _pass(
                survey, machine, box, setup, number, start_s, 100 * seed + len(book.passes)
            )
            start_s = stops[-1].time_s + 20.0
            for stop in stops:
                off_um += sum(
                    slip.size_um
                    for slip in slips
                    if (slip.setup, slip.pass_number, slip.stop) == (setup, number, stop.stop)
                )
                first = {"broken": "beam lost"} if (number, stop.stop) == (1, 0) else {}
                book.add(
                    msgspec.structs.replace(
                        stop, reading_mm=stop.reading_mm + off_um * 1e-3, **first
                    )
                )
    return _judged(survey, book, machine)


def _pass(survey, machine, box, setup, number, start_s, seed):
    how = Alignment() if "-" in setup else Alignment(mirror_mrad=(0.3, -0.2))
    taken = simulate_pass(
        machine,
        box,
        setup,
        number,
        alignment=how,
        conditions=Conditions(noise_um=0.1, seed=seed, start_s=start_s),
    )
    route = make_route(survey.volume, setup, "xyz", outward=number % 2 == 1)
    return [
        CapturedStop(
            setup=setup,
            outward=number % 2 == 1,
            stop=k,
            position_mm=tuple(route.stops_mm[k].tolist()),
            axis=route.axis_to(k),
            stop_count=None,
            reading_mm=float(taken.first_mm + taken.reading_mm[k]),
            u_um=0.1,
            scatter_um=0.2,
            slope_um_s=0.0,
            samples=100,
            rejected=0,
            window_from_ns=int(taken.time_s[k] * 1e9),
            window_to_ns=int(taken.time_s[k] * 1e9) + 1,
            time_s=float(taken.time_s[k]),
            beam=0.9,
        )
        for k in range(len(route))
    ]


def _judged(survey, book, machine):
    result = solve(
        tabulate(survey, book.passes), chain="FXYZ", assumed=assumptions_of(survey)
    )
    book.suspect(suspected(book, result.findings))
    axes = [np.linspace(0.0, size, survey.volume.increments + 1) for size in SIZE_MM]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    true = machine.error_at(points)
    before, after = (
        _rms_um(result, points, field)
        for field in (true, true - error_field_um(result, points))
    )
    findings = settled_findings(book, result.findings, stated={})
    named = {
        f"{each.setup}/{each.pass_number}"
        for each in findings
        if each.setup and each.severity != "info"
    }
    return Survey(
        before,
        after,
        frozenset(f"{each.setup}/{each.pass_number}" for each in book.doubts()),
        frozenset(named),
    )


def _rms_um(result, points, field):
    return float(
        np.sqrt(
            np.mean(np.sum(without_rigid_motion(result.volume, points, field) ** 2, axis=1))
        )
    )
