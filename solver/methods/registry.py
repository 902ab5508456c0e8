import difflib
from collections.abc import Callable
from dataclasses import dataclass

from stepdiag.base.conditions.assumptions import Assumptions
from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message
from stepdiag.base.result.result import Result
from stepdiag.solver.methods.closed_form import solve_least_squares, solve_wang2000
from stepdiag.solver.methods.estimate import solve_estimate
from stepdiag.solver.model.angles import Angles
from stepdiag.solver.model.lateral import MeasuredStraightness
from stepdiag.solver.model.layout import Layout


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """The input of a method. ``trials`` is the number of simulated surveys."""

    chain: str
    angles: Angles | None = None
    straightness: tuple[MeasuredStraightness, ...] = ()
    assumed: Assumptions | None = None
    trials: int = 0


Method = Callable[[Layout, Options], Result]


def _estimate(layout: Layout, options: Options) -> Result:
    return solve_estimate(
        layout,
        options.chain,
        angles=options.angles,
        straightness=options.straightness,
        assumed=options.assumed,
        trials=options.trials,
    )


def _without_angles(name: str, solve: Callable[[Layout, str], Result]) -> Method:
    def method(layout: Layout, options: Options) -> Result:
        if options.angles or options.straightness or options.trials:
            expected = message("use-estimate-with-angles")
            raise UsageError(
                "method", expected=expected, found=repr(name), remedy=message("leave-out")
            )
        return solve(layout, options.chain)

    return method


METHODS: dict[str, Method] = {
    "estimate": _estimate,
    "least-squares": _without_angles("least-squares", solve_least_squares),
    "wang2000": _without_angles("wang2000", solve_wang2000),
}
"""The methods: ``estimate`` returns every identified quantity; ``least-squares`` and
``wang2000`` solve Wang's equations as corrected and as printed."""


def method_of(name: str) -> Method:
    """Return a method by name. Raises ``UsageError`` for an unknown name, with the most similar
    name."""
    if name not in METHODS:
        near = difflib.get_close_matches(name, METHODS)
        remedy = message("did-you-mean", name=repr(near[0])) if near else ""
        raise UsageError(
            "method",
            expected=message("one-of", names=list(METHODS)),
            found=repr(name),
            remedy=remedy,
        )
    return METHODS[name]
