"""The solver's cases: surveys of the virtual machine, every kind of them small, and tables of what
is refused."""

from dataclasses import replace

from _figures import FIGURES
from _files import FILES
from _outlook import OUTLOOK
from _rules import RULES
from _surveys import SMALL, SURVEYS, angles, moved, survey

from testkit.exact.surveys import DIAGONALS, LINEAR


def _back():
    return SMALL.survey(passes=(1, 2))


CASES = (
    FIGURES
    | FILES
    | OUTLOOK
    | RULES
    | SURVEYS
    | {
        "usual": (
            "four diagonals, three runs, all angles known",
            "solve",
            lambda: survey(SMALL.survey(), angles=angles(SMALL)),
        ),
        "usual-no-angles": (
            "four diagonals, three runs, no angles",
            "solve",
            lambda: survey(SMALL.survey()),
        ),
        "diagonals-alone": (
            "four diagonals out, no scale",
            "solve",
            lambda: survey(replace(SMALL, chain="XYFZ").survey(DIAGONALS), chain="XYFZ"),
        ),
        "two-ways": (
            "four diagonals and runs out and back, some angles known",
            "solve",
            lambda: survey(_back(), angles=angles(SMALL, "EAX", "EBX", "ECY")),
        ),
        "outlier": (
            "one stop of a diagonal 30 um off",
            "solve",
            lambda: survey(moved(SMALL.survey(), "npp", 1, lambda stop: 30.0 * (stop == 5))),
        ),
        "slip": (
            "the count of a diagonal slips by 8 um",
            "solve",
            lambda: survey(moved(_back(), "pnp", 1, lambda stop: 8.0 * (stop >= 6))),
        ),
        "printed": (
            "Wang's formulas as printed",
            "solve",
            lambda: survey(SMALL.survey(DIAGONALS), method="wang2000"),
        ),
        "closed": (
            "the closed form, corrected",
            "solve",
            lambda: survey(SMALL.survey((*DIAGONALS, *LINEAR)), method="least-squares"),
        ),
    }
)
