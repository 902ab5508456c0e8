"""From a result and its exports to the conclusion."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stepdiag.base.findings import PROOF, Finding
from stepdiag.base.messages import Words, joined, message
from stepdiag.base.names import BODY_DIAGONALS
from stepdiag.base.result.basis import ASSUMED, Basis, basis_of, scales_in_words
from stepdiag.base.result.interval import Interval, decimals_of, decimals_of_u
from stepdiag.base.result.members import (
    BETWEEN_TARGETS,
    NOT_MEASURED,
    READINGS,
    VOLUME,
    UnseenSlip,
)
from stepdiag.base.result.result import DISPLACEMENTS, ROTATIONS, Result
from stepdiag.base.setups import setup_of
from stepdiag.conclusion.contributions import LEANS, Contribution, contributions_of
from stepdiag.conclusion.intervals import Reach, reach_in, reach_of
from stepdiag.conclusion.sentences import Sentence
from stepdiag.conclusion.verdict import judged_in, verdict_sentences
from stepdiag.exporters.export.written import ExportReport
from stepdiag.exporters.files.naming import UNTESTED
from stepdiag.exporters.safety.state import proof_needed
from stepdiag.exporters.safety.verify import STRETCH

MOST_WRONG = 5
AIR = {
    "air_temperature_c": ("T", "°C"),
    "air_pressure_hpa": ("p", "hPa"),
    "relative_humidity_percent": ("RH", "%"),
}
"""Conditions of the air, each with a letter and a unit that are equal in all languages."""
KNOBS = {
    BETWEEN_TARGETS: "between",
    **dict.fromkeys((READINGS, "bends"), "readings"),
    NOT_MEASURED: "unmeasured",
    **dict.fromkeys(("angles", "short waves of angles"), "angles"),
    **dict.fromkeys(
        ("drift", "wander", "wandering pass", "walk of one pass", "found step"), "passes"
    ),
    **dict.fromkeys(("setup scale", "scale of one setup", "growth"), "setups"),
    **dict.fromkeys(("material temperature", "air"), "lengths"),
}
"""Sources of the uncertainty budget, each with the measure that reduces its share."""
LEAST_SHARE = 0.1
"""The conclusion leaves out an error that is smaller than this share of the largest error."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """The outcome of an export. ``refused`` is the reason of a refusal. ``untested`` contains the
    kinds of tables with an untested sign. ``harmed`` describes the stretches in which the files
    would increase the error. ``unproven`` files need a proof run before their predicted effect is
    certain."""

    controller: str
    refused: Words = ""
    untested: tuple[str, ...] = ()
    reach: Reach | None = None
    harmed: tuple[Words, ...] = ()
    unproven: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Conclusion:
    """The conclusion of a result. ``wrong`` contains the errors of the machine with their
    contributions, the largest first. The other fields contain sentences in the order of reading."""

    wrong: tuple[tuple[Contribution, Sentence], ...]
    unknown: tuple[Sentence, ...]
    reach: Reach | None
    """The predicted volumetric error, or None for a survey of less than three axes."""
    reached: tuple[Sentence, ...]
    verdict: tuple[Sentence, ...]
    """The verdict by ISO 14253-1, as found and as predicted; empty without a tolerance."""
    basis: tuple[Sentence, ...]
    load: tuple[Sentence, ...]
    next_step: Sentence
    findings: dict[str, int]
    """Number of findings of each severity in the result."""


def export_of(written: ExportReport) -> Export:
    kinds = tuple(dict.fromkeys(table.kind for table in written.tables))
    untested = (
        kinds if any(Path(name).stem.endswith(UNTESTED) for name in written.files) else ()
    )
    reach = None if written.prediction is None else reach_of(written.prediction.predicted)
    return Export(
        controller=written.controller,
        untested=untested,
        reach=reach,
        harmed=harmed_in(written.findings),
        unproven=proof_needed(written.findings),
    )


def harmed_in(findings: Iterable[Finding]) -> tuple[Words, ...]:
    """Return the findings about stretches in which files increase the error, from the findings of
    an export or of `verify`."""
    return tuple(one.words for one in findings if one.code == STRETCH)


def conclude(result: Result, exports: Sequence[Export] = ()) -> Conclusion:
    """Return the conclusion of a result. The effect of compensation comes from the prediction of
    the first export, or without an export from the result."""
    counts = {
        severity: sum(one.severity == severity for one in result.findings)
        for severity in ("error", "warning", "info")
    }
    proof = next((one for one in result.findings if one.code == PROOF), None)
    if proof is not None:
        return _of_proof(proof, counts)
    exported = next((each.reach for each in exports if each.reach is not None), None)
    reach = (exported or reach_in(result)) if result.volume.solid else None
    return Conclusion(
        wrong=tuple((one, _wrong_sentence(one)) for one in _wrong(contributions_of(result))),
        unknown=(*_unknown(result), *_unseen([*(result.unseen_slip or ())])),
        reach=reach,
        reached=(
            *_reached(reach, result, refused=_all_refused(exports)),
            *_largest_share(result),
            *_harmed(exports),
        ),
        verdict=tuple(verdict_sentences(judged_in(result, exported))),
        basis=tuple(_basis(basis_of(result))),
        load=tuple(loadable(exports)),
        next_step=_next_step(result, exports, counts),
        findings=counts,
    )


def _of_proof(found: Finding, counts: dict[str, int]) -> Conclusion:
    """Return the conclusion of a proof run with only its verdict: a diagonal and a line do not
    determine the machine's errors."""
    return Conclusion(
        wrong=(),
        unknown=(),
        reach=None,
        reached=(),
        verdict=(),
        basis=(),
        load=(),
        next_step=Sentence(key="next_proof", arguments={"what": found.words}),
        findings=counts,
    )


def _wrong(contributions: Sequence[Contribution]) -> list[Contribution]:
    certain = [one for one in contributions if one.significant and one.effect_um >= 0.05]
    return [one for one in certain if one.effect_um >= LEAST_SHARE * certain[0].effect_um][
        :MOST_WRONG
    ]


def _wrong_sentence(one: Contribution) -> Sentence:
    numbers = {
        "um": _um(one.effect_um),
        "length": f"{one.length_mm:.0f}",
        "value": _magnitude(one),
        "axis": one.axis,
        "name": one.name,
    }
    more = "positive" if one.value > 0 else "negative"
    match one.kind:
        case "squareness":
            return Sentence(
                key="wrong_squareness",
                arguments={**numbers, "to": LEANS[one.name][1], "towards": _towards(one)},
            )
        case "scale":
            return Sentence(key=f"wrong_scale_{more}", arguments=numbers)
        case "straightness":
            return Sentence(
                key="wrong_straightness", arguments={**numbers, "to": one.name[1]}
            )
        case _:
            return Sentence(key=f"wrong_{one.kind}", arguments=numbers)


def _magnitude(one: Contribution) -> str:
    if one.kind not in ("squareness", "scale") or not one.u_um:
        return _um(abs(one.value))
    return f"{abs(one.value):.{decimals_of_u(2e3 * one.u_um / one.length_mm)}f}"


def _towards(one: Contribution) -> str:
    """Return the direction in which the tool moves when an axis that is out of square moves in +:
    dX = -C0Y y, dX = +B0Z z, dY = -A0Z z (contract 1)."""
    grows = one.value > 0 if one.name == "B0Z" else one.value < 0
    return f"{'+' if grows else '−'}{LEANS[one.name][1]}"


def _unknown(result: Result) -> Iterator[Sentence]:
    standing = _standing(result)
    scales = [
        axis
        for axis, scale in result.scale.items()
        if not scale.identified and axis not in standing
    ]
    if scales:
        yield Sentence(key="unknown_scales", arguments={"axes": ", ".join(scales)})
    for name, quantity in result.squareness.items():
        axis, to = LEANS[name]
        if quantity.value is None and not {axis, to} & set(standing):
            yield Sentence(
                key="unknown_squareness", arguments={"name": name, "axis": axis, "to": to}
            )
    functions = [
        name
        for name, function in result.errors.items()
        if function.value is None and name[2] not in standing
    ]
    if functions:
        yield Sentence(key="unknown_functions", arguments={"names": ", ".join(functions)})
    if result.posterior is not None and (
        functions or scales or any(one.value is None for one in result.squareness.values())
    ):
        yield Sentence(key="unknown_usual", arguments={})
    if standing:
        yield Sentence(key="unknown_standing", arguments={"axes": ", ".join(standing)})
    angles = [
        name for name in ROTATIONS if name not in result.errors and name[2] not in standing
    ]
    if angles:
        yield Sentence(
            key="unknown_angles_all" if len(angles) == len(ROTATIONS) else "unknown_angles",
            arguments={"names": ", ".join(angles)},
        )


def _unseen(slips: Sequence[UnseenSlip]) -> Iterator[Sentence]:
    """Yield sentences about slips of the count that can stay undetected: the most harmful slip, and
    the passes in which a slip has a larger effect on the volumetric error than the noise of the
    readings.

    U contains the noise of the readings but no slip. The most harmful slip is always reported,
    because it grows with the noise of the readings.
    """
    blind = next((one for one in slips if one.half_um is None), None)
    if blind is not None:
        yield Sentence(key="unknown_slip_any", arguments={"place": blind.where})
    passes = [name for one in slips for name in one.passes]
    worst = max(
        (one for one in slips if one.half_um is not None),
        key=lambda one: one.volume_um or 0.0,
        default=None,
    )
    if worst is not None:
        sizes = {"half": worst.half_um, "nearly": worst.nearly_um, "volume": worst.volume_um}
        yield Sentence(
            key="unknown_slip",
            arguments={
                "place": worst.where,
                **{name: _um(size or 0.0) for name, size in sizes.items()},
            },
        )
    if passes:
        readings_um = max(one.readings_um or 0.0 for one in slips)
        yield Sentence(
            key="unknown_slip_passes",
            arguments={"passes": _of_setups(passes), "readings": _um(readings_um)},
        )


def _of_setups(passes: Iterable[str]) -> Words:
    numbers: dict[str, list[int]] = {}
    for setup, _, number in (one.partition("/") for one in passes):
        numbers.setdefault(setup, []).append(int(number))
    return joined(
        [message("passes-of", setup=one, passes=every) for one, every in numbers.items()]
    )


def _standing(result: Result) -> list[str]:
    return [
        axis
        for axis, travels in zip("XYZ", result.volume.travelled, strict=True)
        if not travels
    ]


def _reached(reach: Reach | None, result: Result, *, refused: bool) -> Iterator[Sentence]:
    if reach is None:
        yield Sentence(
            key="reach_axes_alone",
            arguments={
                "axes": ", ".join(axis for axis in "XYZ" if axis not in _standing(result))
            },
        )
        return
    yield _figure("before", reach.rms_before, reach.largest_before)
    if reach.rms_after is not None and reach.largest_after is not None:
        after = _figure("after", reach.rms_after, reach.largest_after)
        yield (
            replace(after, key="reach_after_refused")
            if refused and after.key == "reach_after"
            else after
        )


def _largest_share(result: Result) -> Iterator[Sentence]:
    shares = {} if result.budget is None else result.budget.shares.get(VOLUME, {})
    square = {
        knob: sum(
            shares.get(source, 0.0) ** 2 for source, its in KNOBS.items() if its == knob
        )
        for knob in KNOBS.values()
    }
    knob = max(square, key=lambda one: square[one])
    if square[knob] > 0.0:
        percent = f"{100.0 * square[knob] / sum(share**2 for share in shares.values()):.0f}"
        more = Sentence(
            key=f"largest_{knob}", arguments={"increments": f"{2 * result.volume.increments}"}
        )
        yield Sentence(key="reach_largest", arguments={"percent": percent, "what": more})


def _harmed(exports: Sequence[Export]) -> Iterator[Sentence]:
    for one in exports:
        yield from (
            Sentence(key="reach_harmed", arguments={"control": one.controller, "what": text})
            for text in one.harmed
        )


def _all_refused(exports: Sequence[Export]) -> bool:
    return bool(exports) and all(each.refused for each in exports)


def _basis(found: Basis) -> Iterator[Sentence]:
    if found.tables is not None and found.material_c is None:
        yield Sentence(key=f"basis_{found.tables}_alone")
    elif found.tables is not None:
        arguments = {
            "warm": f"{found.material_c:.2f}",
            "scales": scales_in_words(found.scales),
            "other": scales_in_words(found.other),
        }
        yield Sentence(
            key=f"basis_{found.tables}" + ("" if found.other else "_only"),
            arguments=arguments,
        )
    if found.air:
        values = ", ".join(
            f"{letter} = {found.air[name]:g} {unit}"
            for name, (letter, unit) in AIR.items()
            if name in found.air
        )
        yield Sentence(key="basis_air_assumed", arguments={"values": values})
    if (taken := taken_for_granted(found.assumed)) is not None:
        yield taken
    if found.tool_um is not None:
        yield Sentence(key="basis_tool", arguments={"um": _um(found.tool_um)})


def taken_for_granted(assumed: Mapping[str, float]) -> Sentence | None:
    """Return the assumed sizes behind U as a sentence, or None if a size is missing.

    Results of older versions contain no growth, because the older versions assumed that the machine
    does not grow.
    """
    sizes = {"growth_um_m": 0.0, **assumed}
    if not sizes.keys() >= set(ASSUMED):
        return None
    return Sentence(
        key="basis_assumed", arguments={name: f"{sizes[name]:g}" for name in ASSUMED}
    )


def _figure(when: str, rms: Interval, largest: Interval) -> Sentence:
    low, high = rms.shown()
    if not low:
        return Sentence(
            key=f"reach_{when}_unsure",
            arguments={"rms": rms.best(), "largest": largest.best()},
        )
    arguments = {"low": low, "high": high, "largest": largest.shown()[1] or largest.best()}
    return Sentence(key=f"reach_{when}", arguments=arguments)


def loadable(exports: Sequence[Export]) -> Iterator[Sentence]:
    """Yield one sentence per control: whether the files of its export can be loaded now. Tables
    with an untested sign must not be loaded before the sign test."""
    if not exports:
        yield Sentence(key="load_none")
    for one in exports:
        if one.refused:
            yield Sentence(
                key="load_refused", arguments={"control": one.controller, "why": one.refused}
            )
        elif one.untested:
            yield Sentence(
                key="load_untested",
                arguments={
                    "control": one.controller,
                    "kinds": ", ".join(
                        kind.upper() if len(kind) == 3 else kind for kind in one.untested
                    ),
                },
            )
        else:
            key = "load_proof" if one.unproven else "load_now"
            yield Sentence(key=key, arguments={"control": one.controller})


def _next_step(result: Result, exports: Sequence[Export], counts: dict[str, int]) -> Sentence:
    if counts["error"]:
        return Sentence(key="next_error")
    usable = [each for each in exports if not each.refused]
    if not usable and (missing := _missing(result, refused=bool(exports))) is not None:
        return (
            Sentence(key="next_runs", arguments={"runs": ", ".join(missing)})
            if missing
            else Sentence(key="next_unknown")
        )
    if _all_refused(exports):
        return Sentence(key="next_refused", arguments={"control": exports[0].controller})
    if any(each.untested for each in usable):
        return Sentence(
            key="next_sign_test",
            arguments={"control": next(each.controller for each in usable if each.untested)},
        )
    return Sentence(key="next_load" if usable else "next_export")


def _missing(result: Result, *, refused: bool) -> list[str] | None:
    """Return the missing runs without which no table can be made. Return an empty list if repeated
    runs are needed instead, or None if no run is missing.

    An export is not refused because of unknown scales alone, so a ``refused`` export has another
    reason. The diagonals determine the sum of the three scales, so runs are needed along all axes
    with an unknown scale except the longest one.
    """
    if not result.volume.solid:
        return None
    torn = [name for name, quantity in result.squareness.items() if quantity.value is None]
    torn += [name for name in DISPLACEMENTS if result.errors[name].value is None]
    scales = [axis for axis, scale in result.scale.items() if not scale.identified]
    if not torn and (refused or not scales):
        return None
    lengths = dict(zip("XYZ", result.volume.size_mm, strict=True))
    kept = max(scales, key=lambda axis: lengths[axis], default="")
    driven = {setup_of(name).base for name in result.setups}
    diagonals = [name for name in BODY_DIAGONALS if torn and name not in driven]
    return diagonals + [f"linear-{axis.lower()}" for axis in scales if axis != kept]


def _um(value: float) -> str:
    return f"{value:.{decimals_of(value)}f}"
