"""The recording process: the daemon, the process for the page, and the Python settings for both.

Arrival stamps are late if another thread of this process holds the interpreter. So threads yield
after a tenth of the usual time. The garbage collector ignores all imported objects, because their
examination stops the process for 20 ms.
"""

import gc
import os
import sys
from collections import Counter
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepdiag.base.errors import UsageError
from stepdiag.base.messages import message

if TYPE_CHECKING:
    import asyncio
    from contextlib import AbstractAsyncContextManager

    from stepdiag.daq.service.daemon import Daemon
    from stepdiag.daq.survey.models import Survey

SOCKET = "STEPDIAG_PAGE_SOCKET"
"""Environment variable, set in the unit: the path of the socket by which the page's unit
connects."""
PAGE_ACCOUNT = "stepdiag-page"
MOST_KINDS = 100
GIVE_WAY_S = 0.0005
"""Longest time in s for which a computing thread runs while another thread waits."""


def record(survey_file: Path, *, verbose: bool = False) -> None:
    """Record surveys until the end of the process; solve and export each complete survey. Raises
    the errors of `serve`."""
    # A garbage collection during the imports would take a tenth of the start time.
    gc.disable()
    sys.setswitchinterval(GIVE_WAY_S)
    import asyncio

    from stepdiag.daemon.journal import configure

    configure(verbose=verbose)
    again = (sys.executable, "-P", "-m", "stepdiag")  # no import from the working directory
    ahead = (*again, "next", str(survey_file), "--note")
    asyncio.run(
        serve(
            survey_file,
            completion=(*again, "complete"),
            archiving=(*again, "pack"),
            ahead=ahead,
        )
    )


async def serve(
    survey_file: Path,
    *,
    completion: Sequence[str],
    archiving: Sequence[str] = (),
    ahead: Sequence[str] = (),
) -> None:
    """Run the daemon of a survey file until its end, with page and metrics in a separate process.

    Raises the errors of the survey file and the folder, and DeviceError if the address of the page
    is in use.
    """
    import asyncio

    from stepdiag.daq.service.daemon import Daemon

    asyncio.get_running_loop().set_exception_handler(_seldom())
    daemon = Daemon(survey_file, completion, archiving, ahead, _programs)
    daemon.take_folder()  # a port that is in use must not lead to another port
    _say_what_hides(daemon.survey)
    page, metrics = daemon.survey.page, daemon.survey.metrics
    async with AsyncExitStack() as beside:
        if SOCKET in os.environ:
            await beside.enter_async_context(
                _page_elsewhere(daemon, Path(os.environ[SOCKET]))
            )
        elif page.enabled or metrics.enabled:
            await beside.enter_async_context(_page_beside(daemon, survey_file))
        gc.freeze()
        gc.enable()
        await daemon.run()


def _say_what_hides(survey: "Survey") -> None:
    import structlog

    from stepdiag.completion.foreseen import hidden_slip

    for found in hidden_slip(survey):
        structlog.get_logger("service").info(
            "finding", code=found.code, severity=found.severity, text=str(found.words)
        )


def _seldom() -> "Callable[[asyncio.AbstractEventLoop, dict[str, Any]], None]":
    """Return a handler that logs a failure outside all tasks: only the first, the tenth, the
    hundredth failure of each kind and so on, because a PLC with invalid answers can cause any
    number of failures."""
    import structlog

    log, counts = structlog.get_logger("service"), Counter[str]()

    def say(_loop: "asyncio.AbstractEventLoop", context: "dict[str, Any]") -> None:
        what = f"{context['message']}: {context.get('exception')!r}"[:300]
        counts[what if len(counts) < MOST_KINDS else ""] += 1
        count = counts[what]
        if str(count).strip("0") == "1":
            log.error("aside", words=what, count=count)

    return say


def _page_elsewhere(daemon: "Daemon", path: Path) -> "AbstractAsyncContextManager[None]":
    import pwd

    from stepdiag.page.keeper import page_served

    try:
        account = pwd.getpwnam(PAGE_ACCOUNT).pw_uid
    except KeyError:
        remedy = message("run-command", command="systemd-sysusers")
        raise UsageError(
            PAGE_ACCOUNT,
            expected=message("account-of-page"),
            found=message("none"),
            remedy=remedy,
        ) from None
    return page_served(path, account, daemon.status_source, daemon.status_source.figures)


@asynccontextmanager
async def _page_beside(daemon: "Daemon", survey_file: Path) -> AsyncIterator[None]:
    import structlog

    from stepdiag.page.keeper import Listeners, address_of, page_kept
    from stepdiag.page.settings import in_the_clear, page_settings

    log = structlog.get_logger("service")
    page, metrics = daemon.survey.page, daemon.survey.metrics
    settings = page_settings(survey_file, daemon.survey)
    listeners = Listeners.opened(page, metrics)
    if listeners.page is not None:
        address = address_of(listeners.page, "https" if settings.certificate else "http")
        log.info(
            "page",
            address=address,
            commands="with token" if settings.token else "none: read only",
        )
        if in_the_clear(page, settings):
            log.warning(
                "page-in-the-clear",
                address=address,
                token="sent in the clear" if settings.token else "none",
            )
    if listeners.metrics is not None:
        log.info("metrics", address=f"{address_of(listeners.metrics)}/metrics")
    async with page_kept(
        daemon.status_source, settings, listeners, daemon.status_source.figures
    ):
        yield


def _programs(survey: "Survey") -> dict[str, str]:
    named = [each.controller for each in survey.exports] + (
        [survey.proof.controller] if survey.proof is not None else []
    )
    if not named:
        return {}
    from stepdiag.daemon.driving import sequence_of
    from stepdiag.exporters.programs import CONTROLS, program_name

    control = next((name for name in named if name in CONTROLS), "")
    if not control:
        return {}
    sequence = sequence_of(survey)
    return {setup: program_name(sequence, control, setup) for setup in survey.plan.all_setups}
