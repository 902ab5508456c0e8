"""The findings on the errors of a survey: one cause, or all probable causes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stepdiag.base.findings import Finding, error, finding, warning
from stepdiag.base.messages import Argument, Message, Place, message
from stepdiag.base.names import PRODUCTS
from stepdiag.base.readings.readings import PassKey
from stepdiag.solver.adjustment.evidence import PLACE, PRODUCT, STOP, WALK
from stepdiag.solver.adjustment.exchanged import Names
from stepdiag.solver.adjustment.explanations import Explained
from stepdiag.solver.adjustment.faults import LEAST_UM, Fault, Suspicion
from stepdiag.solver.model.layout import Layout


def name_suspicion(layout: Layout, suspicion: Suspicion) -> Finding:
    """Return the finding with the passes and stops of a suspicion."""
    every = suspicion.faults
    kinds, among = {one.kind for one in every}, _passes_of(layout, every)
    if kinds == {WALK}:
        return _name_walks(layout, every)
    if suspicion.decided:
        return _name_decided(layout, suspicion.best)
    suspects = [_suspect(layout, one) for one in every]
    if kinds != {STOP}:
        return finding(
            "error", message("contradiction-ambiguous", suspects=suspects), among=among
        )
    # if the machine errors differ by less, the result hardly changes, and the survey is usable
    if suspicion.apart_um > LEAST_UM:
        return finding(
            "error",
            message(
                "contradiction-ambiguous.apart",
                suspects=suspects,
                apart_um=suspicion.apart_um,
            ),
            among=among,
        )
    return warning("contradiction-ambiguous.stop", suspects=suspects)


def name_names(layout: Layout, probable: Sequence[Names], *, decided: bool) -> Finding:
    """Return the finding of setups that have probably measured other diagonals; ``decided`` if the
    readings agree with one assignment alone.
    """
    setups = [setup.name for setup in layout.setups]
    wrong = [
        {setups[at]: setups[of] for at, of in enumerate(names) if at != of}
        for names in probable
    ]
    named = [{"setups": list(each), "driven": list(each.values())} for each in wrong]
    if decided and set(wrong[0]) == set(wrong[0].values()):
        return error("step-mismatch.names", **named[0])
    suspects = [message("suspect-names", **each) for each in named]
    among = [key.place for key in layout.passes if any(key.setup in each for each in wrong)]
    return finding(
        "error", message("step-mismatch.programs", suspects=suspects), among=tuple(among)
    )


def name_excess(count: int) -> Finding:
    return error("too-many-outliers", count=count)


def name_explained(layout: Layout, found: Explained) -> list[Finding]:
    """Return the finding on the named cause outside the model."""
    products = [
        suspect(layout, found, at) for at in found.names if found.kinds[at] == PRODUCT
    ]
    if products:
        return [warning("machine-beside-model", suspects=products)]
    scales = [
        (layout.setups[found.named[at]].name, float(found.size[at])) for at in found.names
    ]
    return [warning("setup-scale-off", setup=name, scale_um_m=size) for name, size in scales]


def suspect(layout: Layout, found: Explained, at: int) -> Message:
    """Return the words for one explanation outside the model."""
    size = float(found.size[at])
    if found.kinds[at] == PRODUCT:
        return message(
            "suspect-product", product=tuple(PRODUCTS)[found.named[at]], size_um=size
        )
    return message(
        "suspect-scale", setup=layout.setups[found.named[at]].name, scale_um_m=size
    )


def _name_decided(layout: Layout, one: Fault) -> Finding:
    key = layout.passes[int(layout.pass_index[one.named])]
    stop = int(layout.stop[one.named])
    place = Place(setup=key.setup, pass_number=key.number, stop=stop)
    if one.kind == PLACE:
        words = message(
            "machine-beside-model.place", setup=key.setup, stop=stop, size_um=one.size
        )
        return finding("warning", words, Place(setup=key.setup), size_um=one.size)
    words = message(
        "stop-outlier" if one.kind == STOP else "count-step",
        place=layout.place(one.named),
        size_um=one.size,
    )
    return finding("warning", words, place, size_um=one.size)


def _suspect(layout: Layout, one: Fault) -> Message:
    if one.kind == WALK:
        return message("suspect-pass", **_of_walk(layout, one))
    if one.kind == PLACE:
        setup = layout.setups[int(layout.setup_index[one.named])].name
        return message(
            "suspect-place", setup=setup, stop=int(layout.stop[one.named]), size_um=one.size
        )
    return message(
        "suspect-stop" if one.kind == STOP else "suspect-step",
        place=layout.place(one.named),
        size_um=one.size,
    )


def _name_walks(layout: Layout, walks: Sequence[Fault]) -> Finding:
    among = _passes_of(layout, walks)
    if len(walks) > 1:
        return finding(
            "error",
            message(
                "pass-wanders.which", suspects=[_suspect(layout, walk) for walk in walks]
            ),
            among=among,
        )
    setup = layout.setups[int(layout.setup_index[walks[0].named])].name
    about = _of_walk(layout, walks[0])
    if _driven_again(layout, walks[0].rows):
        return warning("pass-wanders.driven-again", setup=setup, **about)
    return finding("error", message("pass-wanders", setup=setup, **about), among=among)


def _passes_of(layout: Layout, every: Sequence[Fault]) -> tuple[str, ...]:
    rows = np.concatenate(
        [one.rows if one.kind in (WALK, PLACE) else [one.named] for one in every]
    )
    named = {layout.passes[int(number)] for number in layout.pass_index[rows]}
    return tuple(key.place for key in layout.passes if key in named)


def _of_walk(layout: Layout, walk: Fault) -> dict[str, Argument]:
    first, last = (int(layout.stop[walk.rows[place]]) for place in (0, -1))
    passes = [
        layout.passes[int(number)].words
        for number in dict.fromkeys(layout.pass_index[walk.rows])
    ]
    return {
        "passes": passes,
        "first": first,
        "last": last,
        "size_um": walk.size * float(np.sqrt(len(walk.rows) - 1)),
    }


def _driven_again(layout: Layout, rows: NDArray[np.int64]) -> bool:
    mine: set[PassKey] = {layout.passes[int(number)] for number in layout.pass_index[rows]}
    others = [key for key in layout.passes if key not in mine]
    return all(
        any(key.setup == other.setup and key.outward == other.outward for other in others)
        for key in mine
    )
