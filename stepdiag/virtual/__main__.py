"""``python -m stepdiag.virtual --config FILE.toml [--directory DIR]``: the bench as a separate
process.

The process prints a JSON line with the addresses of its devices when the bench is ready, and a line
for every event of the program. Standard input accepts one command per line: ``start`` begins the
next setup, ``start npp`` drives a setup again, ``fault {...}`` injects a fault in JSON, ``quit``
ends the bench. SIGTERM and SIGINT also end the bench.
"""

import argparse
import json
import signal
import sys
import threading
from collections.abc import Mapping
from pathlib import Path

import msgspec

from stepdiag.virtual.base.faults import Fault
from stepdiag.virtual.bench.bench import VirtualBench
from stepdiag.virtual.bench.config import BenchConfig, read_config


def main(arguments: list[str] | None = None) -> int:
    """Run a bench until ``quit``; return the exit code (2 for a wrong configuration)."""
    options = _parse(arguments)
    options.directory.mkdir(parents=True, exist_ok=True)
    done = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: done.set())
    try:
        config = read_config(options.config) if options.config else BenchConfig()
        bench = VirtualBench(config, options.directory, tell=_print)
    except ValueError as error:
        sys.stderr.write(f"{options.config}: {error}\n")
        return 2
    # the devices can be reached from here on; lines about the program come only after this line
    _print({"event": "ready", **bench.addresses})
    with bench:
        threading.Thread(
            target=_listen, args=(bench, done), name="commands", daemon=True
        ).start()
        done.wait()
    return 0


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m stepdiag.virtual", description="A virtual machine, PLC and laser."
    )
    parser.add_argument(
        "--config", type=Path, help="TOML file; without it a machine with all defaults"
    )
    parser.add_argument(
        "--directory",
        type=Path,
        default=Path(),
        help="where the links of the serial lines appear",
    )
    return parser.parse_args(arguments)


def _listen(bench: VirtualBench, done: threading.Event) -> None:
    for line in sys.stdin:
        command, _, rest = line.strip().partition(" ")
        if command == "quit":
            done.set()
        elif command:
            try:
                _obey(bench, command, rest)
            except ValueError as error:  # an unreadable fault is refused as well
                _print({"event": "refused", "text": str(error)})


def _obey(bench: VirtualBench, command: str, rest: str) -> None:
    match command:
        case "start":
            bench.start_setup(rest)
        case "fault":
            bench.inject(msgspec.json.decode(rest, type=Fault))
        case _:
            raise ValueError(f"expected start, fault or quit, found {command!r}")


def _print(event: Mapping[str, str | int]) -> None:
    sys.stdout.write(json.dumps(event) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
