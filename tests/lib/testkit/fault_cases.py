"""Faults of a survey, each with what is said of it and what becomes of the files: the table of
docs/faults.md, and the tests of it."""

from dataclasses import dataclass, field
from pathlib import Path

from testkit.exact.driven import (
    BOX_MM,
    SETUPS,
    Fault,
    Program,
    judged,
    machine_of,
    recorded,
    survey_file,
)

PAGE = Path(__file__).parents[3] / "docs" / "faults.md"
BEGIN, END = (
    "<!-- files after faults: written by `make faults` -->",
    "<!-- end of files after faults -->",
)
STOPPED = '[plc.signals.stopped]\naddress = 2\ntype = "bit"\nbit = 0\n'
COUNTED = (
    STOPPED + "[plc.signals.stop_count]\naddress = 1\n[plc.signals.setup]\naddress = 3\n"
)
SIGNALS = {"": "all", STOPPED: "`stopped` alone", COUNTED: "`stopped`, `setup`, `stop_count`"}
FILES, OPEN, MISSING = "files", "no files: doubted", "no files: pass requested again"
SWAPPED = {"swapped": (("ppp", "npp"), ("npp", "ppp"))}
NEARLY = 1.3
NOISE_UM = 0.05
"""What two surveys of a machine without any fault differ by."""


@dataclass(frozen=True)
class Case:
    """One fault in words, where it strikes, the codes that must be said of it, and what becomes of
    the survey."""

    words: str
    becomes: str
    said: tuple[str, ...] = ()
    faults: tuple[Fault, ...] = ()
    signals: str = ""
    seed: int = 1
    drive: dict = field(default_factory=dict)
    """Of the program: ``back``, ``decimals``, ``swapped``, ``size``."""
    bench: dict = field(default_factory=dict)
    again: tuple[str, ...] = ()
    """Setups that are driven once more at the end."""

    def most_left_um(self, clean_um, done):
        """Return the most that the files may leave of the volume's error: about what they leave
        without the fault. A slip with no finding may add what the result states of such a slip, in
        a pass that the result names for it."""
        hidden_um = sum(
            done.unseen.get(f"{each.setup}/{each.number}", 0.0) * abs(each.value)
            for each in self.faults
            if each.kind == "slip" and not self.said
        )
        return NEARLY * clean_um + NOISE_UM + hidden_um

    @property
    def row(self):
        """Return the cells of the table that do not come from a run."""
        said = ", ".join(f"`{code}`" for code in self.said) or "nothing"
        return f"| {self.words} | {SIGNALS[self.signals]} | {said} | {self.becomes} |"


def _one(kind, stop=3, value=0.0, setup="ppp", number=1):
    return (Fault(kind, setup, number, stop, value),)


CLEAN = Case("none", FILES)
CASES = (
    CLEAN,
    Case(
        "positions written with one decimal",
        FILES,
        ("position-differs",),
        drive={"decimals": 1, "size": (300.0, 200.1, 100.3)},
    ),
    Case(
        "a stop measured again 55 µm off, alone",
        OPEN,
        ("reading-differs",),
        (*_one("touched", 4, 55.0), *_one("abort", 4)),
    ),
    Case(
        "the same, driven again from two stops before",
        FILES,
        ("reading-differs",),
        (*_one("touched", 4, 55.0), *_one("abort", 4, 2)),
    ),
    Case(
        "aborted and driven again whole", FILES, ("stop-again",), _one("abort", 4, 4), STOPPED
    ),
    Case(
        "aborted and driven again from a stop",
        FILES,
        ("stop-again",),
        _one("abort", 4, 2),
        COUNTED,
    ),
    Case("feed hold half way", FILES, ("between-stops",), _one("hold"), STOPPED),
    Case(
        "driven home in the middle of a pass",
        FILES,
        ("between-stops",),
        _one("home"),
        STOPPED,
    ),
    Case(
        "program left in the middle, the next setup begun",
        MISSING,
        ("place-unknown",),
        _one("left"),
        STOPPED,
    ),
    Case("counter misses a stop", FILES, ("count-stuck",), _one("missed"), COUNTED),
    Case(
        "counter counts a stop twice", FILES, ("count-disagrees",), _one("doubled"), COUNTED
    ),
    Case(
        "count slips by 200 µm, driven once",
        OPEN,
        ("count-slip", "contradiction-ambiguous"),
        _one("slip", 3, 200.0),
    ),
    Case(
        "by -20 µm, on the first step",
        OPEN,
        ("contradiction-ambiguous",),
        _one("slip", 1, -20.0, "ppn"),
        seed=2,
    ),
    Case("by 5 µm", OPEN, ("contradiction-ambiguous",), _one("slip", 3, 5.0)),
    Case("by 2 µm", OPEN, ("contradiction-ambiguous",), _one("slip", 3, 2.0)),
    Case(
        "by 2 µm, driven out and back",
        OPEN,
        ("count-slip",),
        _one("slip", 3, 2.0),
        drive={"back": True},
    ),
    Case(
        "by 200 µm on the way back",
        OPEN,
        ("count-slip",),
        _one("slip", 3, 200.0, number=2),
        drive={"back": True},
    ),
    Case(
        "by 20 µm in a run along an axis",
        OPEN,
        ("angles-far",),
        _one("slip", 1, 20.0, "linear-y"),
    ),
    Case("a step of 5 µm inside a dwell", OPEN, ("window-step",), _one("jump", 3, 5.0)),
    Case("reading frozen for a dwell", OPEN, ("laser-frozen",), _one("frozen")),
    Case("beam cut on the way", MISSING, ("beam-lost",), _one("beam", 3, 3.3)),
    Case(
        "beam cut, the pass driven again",
        FILES,
        ("beam-lost",),
        _one("beam", 3, 3.3),
        again=("ppp",),
    ),
    Case("laser reset on the way", MISSING, ("step-mismatch",), _one("reset")),
    Case(
        "laser counts the other way round",
        MISSING,
        ("wrong-laser-sign",),
        bench={"sign": -1.0},
    ),
    Case(
        "bytes of the laser lost or changed for half a second",
        OPEN,
        ("bytes-garbled", "laser-unwatched"),
        _one("garbage", 3, 0.3),
    ),
    Case(
        "a stop that the machine does not signal",
        OPEN,
        ("stop-recovered",),
        _one("unsignalled"),
    ),
    Case("a stop that is not driven", MISSING, ("stop-lost",), _one("skipped")),
    Case(
        "the first stop is not driven", MISSING, ("stop-lost",), _one("skipped", 0), COUNTED
    ),
    Case(
        "the first stop is not driven, the pass driven again",
        FILES,
        ("stop-lost",),
        _one("skipped", 0),
        COUNTED,
        again=("ppp",),
    ),
    Case("the PLC silent through a stop", OPEN, ("stop-recovered",), _one("silent", 3, 1.0)),
    Case(
        "registers that stand still for two stops",
        MISSING,
        ("heartbeat-still",),
        _one("dead", 3, 3.0),
    ),
    Case("alarm in a pass", OPEN, ("machine-alarm",), _one("alarm")),
    Case("the stop signal flickers", FILES, (), _one("flicker")),
    Case("position and counter lag by 0.1 s", FILES, (), bench={"lag_s": 0.1}),
    Case(
        "two diagonals driven in each other's place",
        OPEN,
        ("signals-absent",),
        (),
        STOPPED,
        drive=SWAPPED,
    ),
    Case("air at 0.00 C at one stop", FILES, ("conditions-held",), _one("air")),
    Case("101.3 hPa at one stop", FILES, ("conditions-held",), _one("pressure", 3, 1013)),
    Case(
        "100.3 % humidity at one stop", FILES, ("conditions-held",), _one("humidity", 3, 1003)
    ),
    Case(
        "material 35 C at one stop",
        FILES,
        ("sensor-jump", "conditions-held"),
        _one("material", 3, 3500),
    ),
)


def run(case, folder):
    """Record a case, solve, export, verify and load it; return what came of it and the codes that
    were said."""
    drive = {"size": BOX_MM, **case.drive}
    machine = machine_of(case.seed, drive["size"])
    program = Program(machine, faults=case.faults, seed=case.seed, **drive)
    for setup in (*SETUPS, *case.again):
        program.drive(setup)
    (folder / "logs").mkdir()
    text = survey_file(
        size=drive["size"], back=drive.get("back", False), signals=case.signals
    )
    _, found = recorded(folder / "logs", text, program.events(**case.bench))
    done = judged(folder, folder / "logs", machine, drive["size"])
    return done, {each.code for each in found} | done.codes


def what_became(done):
    """Return what became of a survey as the table says it."""
    if done.solve == 3:
        return MISSING
    # 5: doubted; 3: what is doubted is not identified any more
    return (
        OPEN
        if done.export in (3, 5)
        else FILES
        if (done.export, done.verify) == (0, 0)
        else f"{done}"
    )


def figures(done):
    """Return the last cell of the table."""
    return (
        f" {done.before_um:.1f} -> {done.after_um:.2f} |"
        if done.after_um is not None
        else f" {done.before_um:.1f} |"
    )
