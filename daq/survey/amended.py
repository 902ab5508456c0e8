"""Replaces the plan of a survey file; the operator's text around the plan is unchanged."""

import json
import re
from collections.abc import Mapping, Sequence
from datetime import date

import msgspec

from stepdiag.base.errors import StepdiagError, UsageError
from stepdiag.base.messages import message
from stepdiag.base.setups import setup_code
from stepdiag.daq.survey.file import parse_survey
from stepdiag.daq.survey.models import Plan, Proof, Survey

HEADER = re.compile(r"\s*\[")
OFFSETS = "[[plan.beam_offset]]"
PLAN = "[plan]"
VOLUME = "[volume]"
_NOT_PROVED = ("[[export]]", "[head", "[proof]")


def with_plan(text: str, plan: Plan, source: str, increments: int | None = None) -> str:
    """Return a survey file in which ``[plan]`` has the setups, repeats, return passes, dwell and
    shifts of ``plan``, and ``[volume]`` the given ``increments``. The rest is unchanged.

    Raises UsageError if the survey does not support this plan (such as a run of the head without a
    head), or contains its plan in another form.
    """
    lines = text.splitlines(keepends=True)
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += "\n"
    blocks = list[list[str]]()
    for block in _blocks(lines):
        if block[0].strip() == OFFSETS and blocks:
            blocks[-1] += _after_settings(block)
        else:
            blocks.append(block)
    if not any(block[0].strip() == PLAN for block in blocks):
        blocks.append([f"{PLAN}\n"])
    amended = "".join(
        "".join(
            _amended(block, plan) if block[0].strip() == PLAN else _finer(block, increments)
        )
        for block in blocks
    )
    survey = parse_survey(amended, source)
    if increments is not None and survey.box.increments != increments:
        raise UsageError(
            f"{source}: volume",
            expected=message("section-volume-with-one"),
            found=message("another-form"),
            remedy=message("increments-line", increments=increments),
        )
    found = survey.plan
    if found != plan:
        raise UsageError(
            f"{source}: plan",
            expected=message("section-plan-with-one"),
            found=message("another-form"),
            remedy=" ".join(line.strip() for line in _settings(plan).values()),
        )
    return amended


def extends(text: str, recorded: str) -> bool:
    """Return whether the survey file ``text`` equals the file ``recorded`` in a log, except for
    further setups. The further setups must change neither the path nor the setup number of a setup
    in the log.
    """
    if text == recorded:
        return True
    try:
        old = parse_survey(recorded, "log")
        return without_further(parse_survey(text, "survey"), old) == old
    except StepdiagError:
        return False


def without_further(new: Survey, old: Survey) -> Survey:
    """Return the survey ``new`` without its further setups if every setup of ``old`` has the same
    path and setup number in ``new``; otherwise ``new`` unchanged.
    """
    names, before = new.plan.all_setups, old.plan.all_setups
    plan = msgspec.structs.replace(
        new.plan, setups=old.plan.setups, beam_offset=old.plan.beam_offset
    )
    further = len(names) > len(before) and all(
        run in new.planned.runs
        and setup_code(run.setup, names) == setup_code(run.setup, before)
        for run in old.planned.runs
    )
    return msgspec.structs.replace(new, plan=plan) if further else new


def as_proof(
    text: str,
    source: str,
    *,
    name: str,
    plan: Plan,
    active: Sequence[str],
    day: date,
    proof: Proof,
) -> str:
    """Return the survey file of a proof run with this ``name`` and ``plan``; ``active`` are the
    files that were loaded into the control on the ``day``.

    The instruments are unchanged; exports, angles and the 4-DOF head are left out. No next setup is
    proposed, because a proof run ends with its verdict. Raises the errors of `with_plan`.
    """
    settings: dict[str, Mapping[str, object]] = {
        "[survey]": {"name": name},
        "[plan]": {"propose_next": False},
        "[machine]": {
            "compensation": "on",
            "active": list(active),
            "active_date": day,
            "active_source": "stepdiag export",
        },
        "[solver]": {"angles": ""},
    }
    blocks = [
        block
        for block in _blocks(text.splitlines(keepends=True))
        if not block[0].lstrip().startswith(_NOT_PROVED)
    ]
    for header, values in settings.items():
        if not any(block[0].strip() == header for block in blocks):
            blocks.append([f"{header}\n"])
        blocks = [
            _stated(block, values) if block[0].strip() == header else block
            for block in blocks
        ]
    held = {
        field: getattr(proof, field)
        for field in proof.__struct_fields__
        if getattr(proof, field)
    }
    blocks.append(_stated(["\n", "[proof]\n"], held))
    decided = msgspec.structs.replace(plan, propose_next=False)
    return with_plan("".join(line for block in blocks for line in block), decided, source)


def _stated(block: Sequence[str], values: Mapping[str, object]) -> list[str]:
    kept, inside = list[str](), False
    for line in block:
        if inside:
            inside = "]" not in line
        elif "=" in line and line.partition("=")[0].strip() in values:
            inside = "[" in line and "]" not in line
        else:
            kept.append(line if line.endswith("\n") else f"{line}\n")
    below = next(index for index, line in enumerate(kept) if HEADER.match(line)) + 1
    written = [
        f"{key} = {value.isoformat() if isinstance(value, date) else json.dumps(value)}\n"
        for key, value in values.items()
    ]
    return [*kept[:below], *written, *kept[below:]]


def _blocks(lines: Sequence[str]) -> list[list[str]]:
    blocks: list[list[str]] = [[]]
    for line in lines:
        if HEADER.match(line) and blocks[-1]:
            blocks.append([])
        blocks[-1].append(line)
    return blocks


def _finer(block: Sequence[str], increments: int | None) -> list[str]:
    if increments is None or block[0].strip() != VOLUME:
        return list(block)
    return [
        re.sub(r"^(\s*increments\s*=\s*)\d+", rf"\g<1>{increments}", line) for line in block
    ]


def _amended(block: Sequence[str], plan: Plan) -> list[str]:
    settings, made, inside = _settings(plan), list[str](), False
    for line in block:
        key = line.partition("=")[0].strip()
        if inside:
            inside = "]" not in line
        elif key in settings and "=" in line:
            made.append(settings.pop(key))
            inside = "[" in line and "]" not in line
        else:
            made.append(line)
    below = next(index for index, line in enumerate(made) if line.strip() == PLAN) + 1
    missing = [
        line for key, line in settings.items() if getattr(plan, key) != getattr(Plan(), key)
    ]
    offsets = [
        f'{OFFSETS}\nsetup = "{one.setup}"\noffset_mm = {[float(each) for each in one.offset_mm]}\n'
        for one in plan.beam_offset
    ]
    end = len(made) - next(
        (index for index, line in enumerate(reversed(made)) if line.strip()), 0
    )
    return [*made[:below], *missing, *made[below:end], *offsets, *made[end:]]


def _after_settings(block: Sequence[str]) -> list[str]:
    settings = [
        index
        for index, line in enumerate(block)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    return list(block[settings[-1] + 1 :])


def _settings(plan: Plan) -> dict[str, str]:
    named = ", ".join(f'"{name}"' for name in plan.setups)
    return {
        "setups": f"setups = [{named}]\n",
        "return_pass": f"return_pass = {str(plan.return_pass).lower()}\n",
        "repeats": f"repeats = {plan.repeats}\n",
        "axis_orders": f"axis_orders = {json.dumps(plan.axis_orders)}\n",
        "alternate_orders": f"alternate_orders = {str(plan.alternate_orders).lower()}\n",
        "dwell_s": f"dwell_s = {plan.dwell_s}\n",
    }
