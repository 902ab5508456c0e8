"""Questions to a person on a terminal; an option of the command replaces each question."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import typer

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import Words, message
from stepdiag.terminal.viewer import print_words, shown

if TYPE_CHECKING:
    from stepdiag.daq.survey.composed import MachineClass


_WORDS = {
    "good": message("class-good"),
    "ordinary": message("class-ordinary"),
    "poor": message("class-poor"),
}


def on_terminal() -> bool:
    import sys

    return sys.stdin.isatty()


def asked(
    option: str,
    question: Words,
    given: str | None,
    understood: Callable[[str], Any],
    default: str | None = None,
) -> Any:
    """Return the answer to a question from the option or from the person; without a terminal the
    default. After an invalid answer the question is asked again."""
    import click

    if given is not None:
        return understood(given)
    if not on_terminal():
        if default is None:
            raise UsageError(
                f"--{option}",
                expected=message("an-answer"),
                found=message("no-terminal"),
                remedy=message("option-answers", option=option),
            )
        return understood(default)
    while True:
        try:
            return understood(str(typer.prompt(shown(question), default=default)).strip())
        except UsageError as refusal:
            print_words(refusal.message)
        except click.Abort as end:
            raise UsageError(
                "questions", expected=message("an-answer"), found=message("end-of-questions")
            ) from end


def machine_class_asked(
    name: str | None, feedback: str | None, pitch_mm: str | None
) -> "MachineClass":
    """Return the class of the machine, its feedback, and the pitch of its ball screws."""
    from stepdiag.base.conditions.assumptions import CLASSES, FEEDBACKS
    from stepdiag.daq.survey.composed import MachineClass

    if name is None and on_terminal():
        for each, sizes in CLASSES.items():
            numbers = {
                "repeats_um": sizes["repeatability_um"],
                "angles_urad": sizes["angles_urad"],
            }
            print_words(
                message("class-sizes", name=f"{each:<9}", what=_WORDS[each], **numbers)
            )
    usual = MachineClass()
    chosen = asked(
        "machine-class",
        message("ask-machine-class"),
        name,
        _one_of("machine-class", CLASSES),
        usual.name,
    )
    kind = asked(
        "feedback",
        message("ask-feedback"),
        feedback,
        _one_of("feedback", FEEDBACKS),
        usual.feedback,
    )
    stated = f"{usual.pitch_mm:g}" if kind == "scale" and pitch_mm is None else pitch_mm
    pitch = asked("pitch-mm", message("ask-pitch-mm"), stated, _length, f"{usual.pitch_mm:g}")
    return MachineClass(name=chosen, feedback=kind, pitch_mm=pitch)


def _one_of(option: str, names: Any) -> Callable[[str], str]:
    def understood(text: str) -> str:
        if text not in names:
            raise UsageError(
                option, expected=message("one-of", names=tuple(names)), found=repr(text)
            )
        return text

    return understood


def _length(text: str) -> float:
    try:
        length = float(text)
    except ValueError:
        length = 0.0
    if not 0.0 < length <= 10_000.0:
        raise UsageError("pitch-mm", expected=message("length-above-0"), found=repr(text))
    return length
