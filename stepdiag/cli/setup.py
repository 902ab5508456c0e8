"""``stepdiag setup``: a first survey file by questions; an option replaces each question."""

from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from stepdiag.base.errors import DeviceError, UsageError
from stepdiag.base.messages import Message, message
from stepdiag.cli.check import NOT_REACHED
from stepdiag.cli.questions import asked, machine_class_asked, on_terminal
from stepdiag.terminal.viewer import print_words

if TYPE_CHECKING:
    from stepdiag.checking.hearing import Answered
    from stepdiag.daq.survey.composed import Answers

T = TypeVar("T")
SHOWN_BYTES = 24
_FORMATS = ("umd", "nd", "ids3010", "lasertex", "qudis")


def register(app: typer.Typer) -> None:
    app.command("setup")(setup)


def setup(
    file: Annotated[Path, typer.Argument()] = Path("survey.toml"),
    machine: str | None = None,
    laser_port: str | None = None,
    laser_format: str | None = None,
    baud: int = 0,
    host: str | None = None,
    port: int = 0,
    control: str | None = None,
    size: str | None = None,
    origin: str | None = None,
    increments: str | None = None,
    chain: str | None = None,
    compensation: str | None = None,
    machine_class: str | None = None,
    feedback: str | None = None,
    pitch_mm: str | None = None,
    seconds: float = 3.0,
) -> None:
    """Ask the questions for a first survey, show the instruments found, write the survey file."""
    from stepdiag.base.files import refuse_existing, write_new
    from stepdiag.daq.survey.composed import Answers, composed, increments_for

    if not 1.0 <= seconds < float("inf"):
        raise UsageError(
            "--seconds",
            expected=message(
                "number-limited",
                kind=message("a-number"),
                limits=[message("limit-or-more", limit=1)],
            ),
            found=f"{seconds:g}",
        )
    refuse_existing(file)
    line, form, rate = _laser(laser_port, laser_format, baud, seconds)
    found_control, found_host, found_port = _control(control, host, port)
    named = asked("machine", message("ask-machine"), machine, _text)
    size_mm = asked("size", message("ask-size"), size, _three)
    usual = machine_class_asked(machine_class, feedback, pitch_mm)
    answers = Answers(
        name=_name(file),
        machine=named,
        size_mm=size_mm,
        origin_mm=asked("origin", message("ask-origin"), origin, _three, "0 0 0"),
        increments=asked(
            "increments",
            message("ask-increments"),
            increments,
            _whole,
            str(increments_for(size_mm, usual.pitch_mm)),
        ),
        chain=asked("chain", message("ask-chain"), chain, _chain, "FXYZ"),
        compensation=asked(
            "compensation", message("ask-compensation"), compensation, _switched, "?"
        ),
        laser_port=line,
        laser_format=form,
        baud=rate,
        usual=usual,
        control=found_control,
        host=found_host,
        tcp_port=found_port,
    )
    text = composed(answers, file.name)
    well = _shown(text, file.name, seconds)
    write_new(file, text)
    print_words(message("written-next", path=str(file), what=_next(answers, file)))
    if not well:
        raise typer.Exit(NOT_REACHED)


def _laser(
    port: str | None, form: str | None, baud: int, seconds: float
) -> tuple[str, str, int]:
    from stepdiag.checking.hearing import listen, ports

    if port is None:
        seen = ports()
        for number, each in enumerate(seen, start=1):
            print_words(f"  {number}  {each.name}  {each.words}")
        known = {str(number): each.name for number, each in enumerate(seen, start=1)}
        port = asked(
            "laser-port",
            message("ask-laser-port"),
            None,
            lambda text: known.get(text, _port(text)),
        )
    port = _port(port)
    if form is not None:
        return port, _format(form), baud
    heard = _while_saying(
        message("listening-on", port=port), lambda: listen(port, baud, seconds)
    )
    if heard.trouble:
        raise DeviceError("laser", expected=message("audible-port"), found=heard.trouble)
    if heard.format in _FORMATS:
        print_words(
            message(
                "it-is",
                name=heard.format
                if port.startswith("socket://")
                else f"{heard.format}, {heard.baud} baud",
            )
        )
        return port, heard.format, heard.baud
    begins = heard.data[:SHOWN_BYTES].hex(" ") or message("silence")
    print_words(message("nothing-known", what=begins, remedy=message("own-formats")))
    return (
        port,
        asked("laser-format", message("ask-laser-format", names=_FORMATS), None, _format),
        baud,
    )


def _control(control: str | None, host: str | None, port: int) -> tuple[str, str, int]:
    from stepdiag.daq.survey.controls import CONTROLS

    if control is not None and _known_control(control, "--control") == "none":
        return "none", "", port
    host = asked("host", message("ask-host"), host, _text)
    if host == "none":
        return "none", host, port
    if control is not None and not on_terminal():
        return control, host, port
    answered, host, port = _probed(control, host, port)
    if control is not None:
        return control, host, port
    return (
        asked(
            "control",
            message("ask-control", names=(*CONTROLS, "none")),
            None,
            _known_control,
            _likely(answered),
        ),
        host,
        port,
    )


def _probed(control: str | None, host: str, port: int) -> "tuple[list[Answered], str, int]":
    from stepdiag.checking.hearing import PROBED, probe

    controls = PROBED if control is None else (control,)
    spoken = ("Modbus", "S7", "LSV2") if control is None else (control,)
    while True:
        place = f"{host}:{port}" if port else host
        answered = _while_saying(
            message("asking-over", place=place, names=spoken),
            lambda where=host, at=port: probe(where, at, controls),  # type: ignore[misc]
        )
        for each in answered:
            print_words(f"  {each.control}: {each.words}")
        if _likely(answered) is not None:
            return answered, host, port
        other = asked("port", message("ask-port"), None, _elsewhere, "0")
        if other == 0:
            return answered, host, port
        host, port = (other, 0) if isinstance(other, str) else (host, other)


def _while_saying(words: Message, work: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """Return the result of an asynchronous function. The words are printed inside the event loop,
    so that Ctrl-C closes the loop properly."""
    import asyncio

    async def asked_and_done() -> T:
        print_words(words)
        return await work()

    return asyncio.run(asked_and_done())


def _likely(answered: "list[Answered]") -> str | None:
    return next((each.control for each in answered if each.signals is not None), None)


def _shown(text: str, source: str, seconds: float) -> bool:
    from stepdiag.checking.check import Observation
    from stepdiag.checking.diagnosis import diagnose
    from stepdiag.cli.check import show_findings, watched
    from stepdiag.daq.survey.file import parse_survey

    seen = Observation(parse_survey(text, source))
    watched(seen, seconds, quiet=False)
    found = diagnose(seen)
    show_findings(found)
    return not any(each.severity == "error" for each in found)


def _next(answers: "Answers", file: Path) -> Message:
    return (
        message("check-answer-plan", name=str(file))
        if answers.compensation == "?"
        else message("check-then-plan", name=str(file))
    )


def _name(file: Path) -> str:
    import re

    return re.sub(r"[^A-Za-z0-9._-]", "-", file.stem).lstrip("._-")[:64] or "survey"


def _text(text: str) -> str:
    if not text:
        raise UsageError("answer", expected=message("a-text-not-empty"), found=repr(text))
    return text


def _port(text: str) -> str:
    from stepdiag.daq.links.ports.address import network_line

    network_line(_text(text), "laser-port")
    return text


def _format(text: str) -> str:
    if text not in _FORMATS:
        remedy = message("own-formats")
        raise UsageError(
            "laser-format",
            expected=message("one-of", names=_FORMATS),
            found=repr(text),
            remedy=remedy,
        )
    return text


def _known_control(text: str, where: str = "control") -> str:
    from stepdiag.daq.survey.controls import CONTROLS

    if text not in (*CONTROLS, "none"):
        raise UsageError(
            where, expected=message("one-of", names=(*CONTROLS, "none")), found=repr(text)
        )
    return text


def _three(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.replace(",", " ").split())
    except ValueError:
        raise UsageError(
            "answer",
            expected=message("such-as", what=message("three-numbers"), example="500 400 300"),
            found=repr(text),
        ) from None
    return x, y, z


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise UsageError(
            "answer", expected=message("whole-number"), found=repr(text)
        ) from None


def _elsewhere(text: str) -> int | str:
    return _tcp_port(text) if text.lstrip("-").isdecimal() else _text(text)


def _tcp_port(text: str) -> int:
    number = _whole(text)
    if not 0 <= number < 65536:
        raise UsageError("port", expected=message("tcp-port-or-0"), found=repr(text))
    return number


def _chain(text: str) -> str:
    if sorted(text.upper()) != sorted("FXYZ"):
        raise UsageError(
            "chain",
            expected=message("such-as", what=message("chain-letters"), example="FXYZ"),
            found=repr(text),
        )
    return text


def _switched(text: str) -> str:
    if text not in ("off", "?"):
        remedy = message("compensation-on")
        raise UsageError(
            "compensation",
            expected=message("one-of", names=["off", "?"]),
            found=repr(text),
            remedy=remedy,
        )
    return text
