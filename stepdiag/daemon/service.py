"""The recording process: the daemon with the page beside it, in one event loop, and how Python is set up around them.

What disturbs arrival stamps is another thread of this process that holds the interpreter. So threads give way ten times sooner than
usual; and the collector of garbage, which holds everything up for 20 ms when it walks through all that was imported, never sees that.
"""

import gc
import sys
from collections.abc import Sequence
from contextlib import AsyncExitStack
from pathlib import Path

GIVE_WAY_S = 0.0005
"""How long a thread that computes may go on while another one waits."""


def record(survey_file: Path, *, verbose: bool = False) -> None:
    """Record surveys, solve and export each when its last pass is in, until told to stop. Raises as `serve` does."""
    gc.disable()  # a tenth of the start would be spent on looking for garbage in what is being imported
    sys.setswitchinterval(GIVE_WAY_S)
    import asyncio

    from stepdiag.daemon.journal import configure

    configure(verbose=verbose)
    again = (sys.executable, "-m", "stepdiag")
    asyncio.run(serve(survey_file, completion=(*again, "complete"), archiving=(*again, "archive")))


async def serve(survey_file: Path, *, completion: Sequence[str], archiving: Sequence[str] = ()) -> None:
    """Run the daemon of a survey file until it is told to stop, with page and metrics as that file says.

    Raises what refuses the survey file or the folder, and DeviceError where the page's address is taken.
    """
    import structlog

    from stepdiag.daq.service.daemon import Daemon

    log = structlog.get_logger("service")
    daemon = Daemon(survey_file, completion, archiving, _programs(survey_file))
    page, metrics = daemon.survey.page, daemon.survey.metrics
    async with AsyncExitStack() as beside:
        if page.enabled:
            from stepdiag.page.server import page_served

            address = await beside.enter_async_context(
                page_served(daemon.status_source, host=page.host, port=page.port, token=page.token, language=page.language)
            )
            log.info("page", address=address, commands="with token" if page.token else "none: read only")
        if metrics.enabled:
            from stepdiag.daemon.metrics import create_metrics
            from stepdiag.page.server import app_served

            address = await beside.enter_async_context(
                app_served(create_metrics(daemon.status_source.figures), host=metrics.host, port=metrics.port, section="metrics")
            )
            log.info("metrics", address=f"{address}/metrics")
        gc.freeze()
        gc.enable()
        await daemon.run()


def _programs(survey_file: Path) -> dict[str, str]:
    """Return the name of the NC program of each setup, for the first control of the survey that programs are written for."""
    from stepdiag.daq.survey.file import load_survey

    survey = load_survey(survey_file)
    if not survey.exports:
        return {}
    from stepdiag.daemon.driving import sequence_of
    from stepdiag.exporters.programs import CONTROLS, program_name

    control = next((each.controller for each in survey.exports if each.controller in CONTROLS), "")
    if not control:
        return {}
    sequence = sequence_of(survey)
    return {setup: program_name(sequence, control, setup) for setup in survey.plan.all_setups}
