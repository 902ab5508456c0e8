"""Shops with one thing wrong between machine, laser and survey file: bytes and blocks through the
real session, in virtual time.

A shop is a drawn machine, what its signals are, and a cause: the statement of the survey file that
is not so. The machine and the laser do what they do; the survey file states the default. `surveyed`
records all of it with real logs, and solves, exports and loads the files.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stepdiag.base.findings import Finding
from stepdiag.daq.recording.session import Round, Session
from stepdiag.daq.recording.sinks import DirectSink
from stepdiag.daq.survey.file import parse_survey
from testkit.exact.driven import (
    BOX_MM,
    ERRS,
    RATE_HZ,
    SETUPS,
    WALL_OFFSET_NS,
    Bench,
    Fault,
    Judged,
    Program,
    judged,
    machine_of,
    survey_file,
)
from testkit.timeline import STOPPED_ONLY, arrival

DIAGONALS = ("ppp", "npp", "pnp", "ppn")
NO_SIGNALS = "[none]"
MACHINES = {"all": "", "stopped": STOPPED_ONLY, "none": NO_SIGNALS}
CONTRACT = ">HHHHiiiHHHH"
DWELL_S = 0.9
AIR = (2010, 2150, 10132, 455)
INDEX = 1.0002713
"""The index of that air, by Ciddor (1996)."""
X, Y, Z = 4, 5, 6
"""Places of the positions in the contract's block, unpacked."""


@dataclass(frozen=True)
class Shop:
    """One shop: ``cause`` and its ``value`` in words, and what they make of registers, count and
    times."""

    seed: int
    machine: str
    cause: str
    value: str = ""
    size: tuple = BOX_MM
    order: str = "xyz"
    map: Callable = None
    """Takes the three positions in mm and returns what the control shows."""
    codes: Callable = None
    """Takes a setup's number and returns the control's."""
    factor: float = 1.0
    """What the laser reads for a true millimetre."""
    laser_late_s: float = 0.0
    plc_late_s: float = 0.0
    bit_early_s: float = 0.0
    driven_size: tuple = ()
    swapped: tuple = ()
    faults: tuple = ()
    back: bool = False
    rate: float = 1.0
    """How many samples the laser sends for each that the survey file states."""
    wavelength_nm: float = 632.991
    """As the file states it."""
    overrun: bool = True
    """Whether the machine goes beyond the first and the last stop of a pass."""
    expands: bool = False
    """Whether the file has readings brought to 20 C."""
    compensated: bool = True
    """What the survey file states of the laser's air."""
    air: tuple = AIR
    """Material and air temperature in 0.01 C, pressure and humidity in 0.1: the contract's
    registers 10 to 13."""
    again: tuple = ()
    """Passes that are driven once more, each directly after its setup: setup and numbers."""
    air_um: float = 0.0
    """Standard deviation of the reading by turbulent air: 1/f noise between 0.05 and 5 Hz."""
    scale_um_m: float = ERRS.scale_um_m
    """The machine's own scales are drawn evenly up to so much, either way."""
    rate_hz: float = RATE_HZ
    """How many samples a second the instrument sends."""
    line: str = ""
    """The beginning of the line of the survey file that is wrong; empty where nothing is."""


def draw(seed):
    """Return a drawn shop; every cause comes as often as the others, on every machine on which it
    can be."""
    rng = np.random.default_rng((seed, 40))
    size = tuple(
        float(10 * round(value / 10))
        for value in rng.uniform((200, 150, 80), (600, 400, 300))
    )
    cause = list(CAUSES)[seed % len(CAUSES)]
    kinds = (
        ("all",)
        if cause in NEEDS_POSITIONS
        else ("all", "stopped", "none")
        if cause not in NEEDS_SIGNALS
        else ("all", "stopped")
    )
    shop = Shop(
        seed,
        kinds[(seed // len(CAUSES)) % len(kinds)],
        cause,
        size=size,
        back=bool(rng.integers(2)),
    )
    return CAUSES[cause](shop, rng)


def draw_clean(seed, kind):
    """Return a drawn shop at which nothing is wrong, of a kind of `CLEAN`."""
    rng = np.random.default_rng((seed, 41))
    shop = draw(seed)
    machines = list(MACHINES)[:3]
    plain = Shop(seed, machines[seed % 3], kind, size=shop.size, back=shop.back)
    return CLEAN[kind](plain, rng)


CLEAN = {
    "quiet": lambda shop, _: shop,
    "turbulent air at 50 Hz": lambda shop, rng: replace(
        shop, rate_hz=50.0, air_um=float(rng.uniform(0.2, 1.0))
    ),
    "scales up to 200 um/m": lambda shop, _: replace(shop, machine="all", scale_um_m=200.0),
}
"""Surveys at which nothing is wrong."""


def _turbulent_um(rng, count, rate_hz):
    """Return 1/f noise of standard deviation 1 um: eight relaxations between 0.05 and 5 Hz."""
    corners_hz = np.geomspace(0.05, 5.0, 8)
    size = 1 << int(np.ceil(np.log2(2 * count)))
    hz = np.fft.rfftfreq(size, 1 / rate_hz)
    density = sum(1 / (corner * (1 + (hz / corner) ** 2)) for corner in corners_hz)
    density *= 2 / np.pi / len(corners_hz)
    noise = rng.normal(size=(2, len(hz)))
    return np.fft.irfft(np.sqrt(density * rate_hz * size / 4) * (noise[0] + 1j * noise[1]))[
        :count
    ]


def _scaled(factors):
    return lambda place: tuple(np.asarray(place) * np.asarray(factors))


def _offset(shop, rng):
    at = int(rng.integers(3))
    shift = float(np.round(rng.uniform(5, 400) * rng.choice([-1, 1]), 3))
    axis = "xyz"[at]
    return replace(
        shop,
        value=f"{axis} {shift:g}",
        line=f"plc.signals.{axis}_mm.offset",
        map=lambda place: tuple(np.asarray(place) + shift * np.eye(3)[at]),
    )


def _sign(shop, rng):
    at = int(rng.integers(3))
    factors = np.where(np.arange(3) == at, -1.0, 1.0)
    return replace(
        shop, value="xyz"[at], map=_scaled(factors), line=f"plc.signals.{'xyz'[at]}_mm.scale"
    )


def _factor(shop, rng):
    factor = float(rng.choice([1 / 25.4, 10.0, 2.0, 0.1]))
    return replace(
        shop, value=f"{factor:.4g}", map=_scaled(factor), line="plc.signals.x_mm.scale"
    )


def _permuted(shop, rng):
    to = [(1, 0, 2), (0, 2, 1), (2, 1, 0), (1, 2, 0)][int(rng.integers(4))]
    return replace(
        shop,
        value=str(to),
        map=lambda place: tuple(np.asarray(place)[list(to)]),
        line="plc.signals.",
    )


def _togo(shop, _):
    return replace(shop, map=lambda _: (0.0, 0.0, 0.0), line="plc.signals.x_mm")


def _actual(shop, rng):
    return replace(shop, map=lambda place: tuple(np.asarray(place) + rng.normal(0, 1e-3, 3)))


def _diameter(shop, _):
    return replace(shop, map=_scaled((2.0, 1.0, 1.0)), line="plc.signals.x_mm.scale")


def _codes(shop, rng):
    shift = int(rng.choice([1, 10, 100]))
    return replace(
        shop,
        value=f"+{shift}",
        codes=lambda code: code + shift if code else 0,
        line="plc.signals.setup",
    )


def _stuck(shop, _):
    return replace(shop, codes=lambda code: 1 if code else 0, line="plc.signals.setup")


def _order(shop, rng):
    order = str(rng.choice(["yxz", "zxy", "xzy", "yzx", "zyx"]))
    return replace(shop, value=order, order=order, line="volume.axis_order")


def _laser_sign(shop, _):
    return replace(shop, factor=-1.0, line="laser.sign")


def _optics(shop, rng):
    factor = float(rng.choice([2.0, 0.5]))
    return replace(shop, value=f"{factor:g}", factor=factor, line="laser.")


def _laser_late(shop, rng):
    late = float(np.round(rng.uniform(0.05, 0.6), 2))
    return replace(shop, value=f"{late:g} s", laser_late_s=late, line="laser.latency_s")


def _plc_late(shop, rng):
    late = float(np.round(rng.uniform(0.05, 0.6), 2))
    return replace(shop, value=f"{late:g} s", plc_late_s=late, line="plc.latency_s")


def _bit_early(shop, rng):
    early = float(np.round(rng.uniform(0.1, 0.25), 2))
    return replace(shop, value=f"{early:g} s", bit_early_s=early, line="stop.settle_s")


def _other_box(shop, rng):
    at = int(rng.integers(3))
    size = tuple(
        value + (10.0 * round(float(rng.uniform(2, 6))) if at == axis else 0.0)
        for axis, value in enumerate(shop.size)
    )
    return replace(shop, value=f"{size}", driven_size=size, line="volume.size_mm")


def _other_diagonal(shop, rng):
    """The programs of two diagonals are called in each other's place: by one pass that cannot be
    told from a wrong code."""
    first, second = (DIAGONALS[at] for at in rng.permutation(4)[:2])
    line = "plc.signals.setup" if shop.machine == "all" else "plan.setups"
    return replace(
        shop, value=f"{first} {second}", swapped=((first, second), (second, first)), line=line
    )


def _bit_late(shop, rng):
    late = float(np.round(rng.uniform(0.1, 0.25), 2))
    return replace(shop, value=f"{late:g} s", bit_early_s=-late, line="stop.settle_s")


def _rate(shop, rng):
    rate = float(rng.choice([0.5, 2.0]))
    return replace(shop, value=f"{rate:g}", rate=rate, line="laser.line.rate_hz")


def _no_overrun(shop, _):
    return replace(shop, overrun=False, back=True, line="plan.overrun_mm")


def _air_never(shop, _):
    """The file states that the laser has divided by the index; it has not."""
    return replace(shop, factor=INDEX, line="laser.compensated")


def _air_twice(shop, _):
    return replace(shop, compensated=False, line="laser.compensated")


def _expansion_twice(shop, rng):
    """The laser has brought its readings to 20 C, and the file states that this remains to be
    done."""
    warm = int(rng.integers(3000, 3500))
    return replace(
        shop,
        value=f"{warm / 100:g} C",
        expands=True,
        air=(warm, *AIR[1:]),
        line="machine.apply_expansion",
    )


def _wavelength(shop, rng):
    """The file states a wavelength in vacuum that is another laser's, or that in air."""
    stated_nm, true_nm = [
        (632.8, 632.991),
        (632.991, 543.5),
        (632.991, 1550.0),
        (632.991, 780.24),
    ][int(rng.integers(4))]
    return replace(
        shop,
        value=f"{true_nm:g} nm",
        factor=stated_nm / true_nm,
        wavelength_nm=stated_nm,
        line="laser.",
    )


def _pressure(shop, rng):
    unit, shown = [("kPa", 1013), ("mmHg", 7600), ("inHg", 299)][int(rng.integers(3))]
    return replace(
        shop,
        value=unit,
        compensated=False,
        factor=INDEX,
        air=(2010, 2150, shown, 455),
        line="plc.signals.air_pressure",
    )


def _one_fault(shop, rng):
    """A right file, and one fault in the first pass: no line is wrong."""
    kinds = {
        "hold": 0,
        "home": 0,
        "skipped": 0,
        "abort": 1,
        "beam": 5,
        "reset": 0,
        "slip": 400,
        "unsignalled": 0,
        "doubled": 0,
        "missed": 0,
    }
    kind = str(rng.choice(list(kinds)))
    at = int(rng.integers(1, 6))
    return replace(
        shop, value=f"{kind} at {at}", faults=(Fault(kind, "ppp", 1, at, kinds[kind]),)
    )


CAUSES = {
    "nothing": lambda shop, _: shop,
    "offset": _offset,
    "sign": _sign,
    "factor": _factor,
    "permutation": _permuted,
    "distance to go": _togo,
    "actual position": _actual,
    "diameter": _diameter,
    "codes shifted": _codes,
    "codes stuck": _stuck,
    "axis order": _order,
    "laser sign": _laser_sign,
    "optics factor": _optics,
    "laser late": _laser_late,
    "plc late": _plc_late,
    "stop bit early": _bit_early,
    "other box": _other_box,
    "other diagonal": _other_diagonal,
    "stop bit late": _bit_late,
    "rate": _rate,
    "no overrun": _no_overrun,
    "air never": _air_never,
    "air twice": _air_twice,
    "wavelength": _wavelength,
    "pressure": _pressure,
    "one fault": _one_fault,
    "expansion twice": _expansion_twice,
}
NEEDS_POSITIONS = (
    "offset",
    "sign",
    "factor",
    "permutation",
    "distance to go",
    "actual position",
    "diameter",
    "codes shifted",
    "codes stuck",
    "pressure",
    "expansion twice",
)
NEEDS_SIGNALS = ("plc late", "stop bit early", "stop bit late")


class ShopBench(Bench):
    """The timeline of a shop."""

    shop = Shop(0, "all", "nothing")

    def columns(self):
        t, value, beam = super().columns()
        late = round(self.shop.laser_late_s * self.rate_hz)
        if late:
            value, beam = (
                np.concatenate([np.full(late, value[0]), value[:-late]]),
                np.concatenate([beam[:late], beam[:-late]]),
            )
        if self.shop.air_um:
            rng = np.random.default_rng((self.shop.seed, 42))
            value = value + 1e-3 * self.shop.air_um * _turbulent_um(rng, len(t), self.rate_hz)
        return t, self.shop.factor * value, beam

    def reading(self, t):
        """Return the laser's true reading; a machine that did not move between two standstills does
        not swing at the second."""
        kept, joined = self.stops, []
        for stop in kept:
            if (
                joined
                and joined[-1].position == stop.position
                and joined[-1].reading == stop.reading
            ):
                joined[-1] = replace(
                    joined[-1], seconds=joined[-1].seconds + self.move_s + stop.seconds
                )
            else:
                joined.append(stop)
        self.stops = joined
        value = super().reading(t)
        self.stops = kept
        return value

    def registers(self, now, heartbeat):
        shop = self.shop
        told = list(
            struct.unpack(CONTRACT, super().registers(now - shop.plc_late_s, heartbeat))
        )
        if shop.bit_early_s:
            other = struct.unpack(
                CONTRACT, super().registers(now + shop.bit_early_s, heartbeat)
            )[2]
            told[2] = told[2] | other & 1 if shop.bit_early_s > 0 else told[2] & (other | ~1)
        told[-4:] = shop.air
        if shop.codes is not None:
            told[3] = shop.codes(told[3])
        if shop.map is not None:
            shown = np.clip(
                np.round(np.asarray(shop.map(np.array(told[X : Z + 1]) * 1e-4)) * 1e4),
                -(2**31),
                2**31 - 1,
            )
            told[X : Z + 1] = [int(value) for value in shown]
        return struct.pack(CONTRACT, *told)


@dataclass
class Surveyed:
    """What became of a shop's survey: the findings at the passes' stops in order, with the number
    of stops driven before each."""

    shop: Shop
    findings: list
    after: list
    """How many standstills the machine had made when each finding came."""
    stops: int
    passes: int
    wanted: int
    files: Judged | None = None


def survey_of(shop, *, increments=2):
    """Return the survey file that the shop has written: what is wrong in the shop is not in it."""
    text = survey_file(
        size=shop.size,
        n=increments,
        back=shop.back,
        signals=MACHINES[shop.machine] if shop.machine != "none" else "",
    )
    text = text.replace(f"rate_hz = {RATE_HZ}", f"rate_hz = {shop.rate_hz}")
    text = text.replace("dwell_s = 0.8", f"dwell_s = {DWELL_S}")
    text = text.replace(
        "compensated = true",
        f"compensated = {str(shop.compensated).lower()}\nwavelength_nm = {shop.wavelength_nm}",
    )
    if shop.expands:
        text = text.replace("[machine]\n", "[machine]\napply_expansion = true\n", 1)
    if shop.machine == "none":
        text = (
            text.replace("poll_hz = 40", 'transport = "none"')
            + '[environment]\nsource = "fixed"\n'
        )
    return text


def surveyed(shop, folder, *, text=None, files=True, increments=2):
    """Record a shop's survey into a folder, and solve, export and load its files."""
    machine = machine_of(
        shop.seed,
        shop.driven_size or shop.size,
        errs=replace(ERRS, scale_um_m=shop.scale_um_m),
    )
    program = Program(
        machine,
        size=shop.driven_size or shop.size,
        n=increments,
        back=shop.back,
        seed=shop.seed,
        swapped=shop.swapped,
        order=shop.order,
        dwell_s=DWELL_S,
        overrun=shop.overrun,
        faults=shop.faults,
    )
    for setup in SETUPS:
        program.drive(setup)
        for numbers in [numbers for name, numbers in shop.again if name == setup]:
            program.drive(setup, numbers)
    program.finish()
    bench = type("Drawn", (ShopBench,), {"shop": shop})
    begun = [at for kind, at, _ in program.spans if kind == "lost"]
    logs = folder / "logs"
    logs.mkdir(parents=True, exist_ok=True)
    text = text or survey_of(shop, increments=increments)
    said, after, clock = [], [], [0]
    survey = parse_survey(text, "survey.toml")

    def heard(outcome):
        if isinstance(outcome, Finding):
            said.append(outcome)
            after.append(int(np.searchsorted(ends, clock[0] * 1e-9)))

    session = Session(
        survey,
        text,
        Round(logs, {}),
        DirectSink(),
        on_outcome=heard,
        wall_offset_ns=lambda: WALL_OFFSET_NS,
    )
    events = program.events(bench=bench, rate_hz=shop.rate_hz * shop.rate)
    schedule = Bench(program.stops, move_s=0.3).schedule()
    ends = [end for (_, end), stop in zip(schedule, program.stops, strict=True) if stop.shown]
    starts = (
        [(schedule[at][1] - 0.05, setup) for at, setup in zip(begun, SETUPS, strict=True)]
        if survey.plc.silent
        else []
    )
    for event in events:
        clock[0] = arrival(event)
        if starts and clock[0] * 1e-9 >= starts[0][0] and not session.recording:
            _, setup = starts.pop(0)
            if setup in survey.plan.all_setups and session.book.open_passes(setup):
                session.begin(setup, clock[0])
        session.consume(event)
    session.close("the bench has ended")
    done = sum(each.whole for each in session.book.passes)
    found = Surveyed(
        shop,
        said,
        after,
        len(ends),
        done,
        len(survey.plan.all_setups) * survey.plan.passes_per_setup,
    )
    if files and session.book.complete():
        found.files = judged(folder, logs, machine, shop.size)
    return found


CONTRACT_MAP = """
[plc.signals.heartbeat]
address = 0
[plc.signals.stop_count]
address = 1
[plc.signals.stopped]
address = 2
type = "bit"
[plc.signals.running]
address = 2
type = "bit"
bit = 1
{setup}
{positions}
"""
SETUP_SIGNAL = "[plc.signals.setup]\naddress = 3\noffset = {offset}\n"
MACHINES["no positions"] = CONTRACT_MAP.format(
    setup=SETUP_SIGNAL.format(offset=0), positions=""
)
POSITION = (
    '[plc.signals.{axis}_mm]\naddress = {address}\ntype = "int32"\nscale = {scale!r}\noffset = '
    "{offset!r}\n"
)
MACHINES["no codes"] = CONTRACT_MAP.format(
    setup="",
    positions="".join(
        POSITION.format(axis=axis, address=4 + 2 * at, scale=1e-4, offset=0.0)
        for at, axis in enumerate("xyz")
    ),
)


def corrected(shop, text):
    """Return the survey file with the shop's cause put right: worked out from the cause, not from
    what the program names."""
    exchanged = [dict(shop.swapped).get(setup, setup) for setup in SETUPS]
    lines = {
        "axis order": ("increments = 2\n", f'increments = 2\naxis_order = "{shop.order}"\n'),
        "laser sign": ("compensated = true\n", "compensated = true\nsign = -1\n"),
        "optics factor": ("rate_hz =", f"scale = {1 / shop.factor!r}\nrate_hz ="),
        "wavelength": ("rate_hz =", f"scale = {1 / shop.factor!r}\nrate_hz ="),
        "air never": ("compensated = true", "compensated = false"),
        "air twice": ("compensated = false", "compensated = true"),
        "expansion twice": ("apply_expansion = true\n", ""),
        "stop bit early": ("settle_s = 0.15", f"settle_s = {0.15 + shop.bit_early_s!r}"),
        "other diagonal": (
            str(list(SETUPS)).replace("'", '"'),
            str(exchanged).replace("'", '"'),
        ),
        "laser late": (
            "compensated = true\n",
            f"compensated = true\nlatency_s = {shop.laser_late_s!r}\n",
        ),
        "plc late": ("poll_hz = 40\n", f"poll_hz = 40\nlatency_s = {shop.plc_late_s!r}\n"),
    }
    codes = shop.cause == "codes stuck" or (
        shop.cause == "other diagonal" and shop.machine == "all"
    )
    if shop.cause in lines and not codes:
        return text.replace(*lines[shop.cause], 1)
    shown = [
        np.asarray(shop.map(place) if shop.map else place, dtype=float)
        for place in (np.zeros(3), *100.0 * np.eye(3))
    ]
    positions = []
    for axis in range(3):
        register = int(
            np.argmax([abs(shown[1 + axis][at] - shown[0][at]) for at in range(3)])
        )
        factor = (shown[1 + axis][register] - shown[0][register]) / 100.0
        if factor:
            offset = -shown[0][register] / factor
            positions.append(
                POSITION.format(
                    axis="xyz"[axis],
                    address=4 + 2 * register,
                    scale=float(1e-4 / factor),
                    offset=float(offset),
                )
            )
    setup = (
        ""
        if codes
        else SETUP_SIGNAL.format(offset=float(1 - shop.codes(1)) if shop.codes else 0.0)
    )
    signals = CONTRACT_MAP.format(
        setup=setup, positions="".join(positions) if len(positions) == 3 else ""
    )
    return text.replace("[stop]", signals + "[stop]", 1)
